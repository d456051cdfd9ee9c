"""Identification of 1,000 readings against a plain Gauss-Newton on the same columns: within 3 times.

The plain version is what one would write by hand: nominal start, whitened residual, columns from the same batched
chain, `numpy.linalg.lstsq`, until the step no longer counts. It is not robust, knows no prior, finds no redundancy,
and takes the model, the whitening and the noise for granted.
"""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.data.read import read_dataset
from calib.fit.identify import identify
from calib.fit.least_squares import jacobian
from calib.fit.placing import base_model_of
from calib.fit.readings import readings_of
from calib.model.model import Design
from mocks.campaign import make_campaign, write_campaign
from tests.benchmarks.clock import line, seconds

READINGS = 1000
WANTED = 3.0


def plain_gauss_newton(dataset: Dataset) -> Array:
    """Estimate (m,) of the base model by plain least squares."""
    model = base_model_of(dataset)
    estimate = np.zeros(len(model.parameters))
    readings = readings_of(dataset, dataset.fit_rows, model, estimate)
    design = Design(model, readings.conditions)
    for _ in range(20):
        frames = design.frames(estimate)
        residual = readings.observed.residual(frames).ravel()
        columns = jacobian(design, readings.observed, frames)
        size = np.linalg.norm(columns, axis=0)
        step, *_ = np.linalg.lstsq(columns / size, residual, rcond=1e-9)
        estimate = estimate + step / size
        if np.sqrt(np.mean((columns @ (step / size)) ** 2)) < 1e-6:
            break
    return estimate


def run() -> bool:
    """Print the ratio, after making sure that both find the same robot."""
    with tempfile.TemporaryDirectory() as folder:
        campaign = make_campaign(seed=1, n=READINGS, n_validation=0, effects=[])
        dataset = read_dataset(write_campaign(campaign, Path(folder))["csv"])
    ours, plain = identify(dataset), plain_gauss_newton(dataset)
    conditions = dataset.conditions
    apart = ours.predict(conditions) - Design(ours.model, conditions).predict(plain)
    if np.abs(apart).max() > 2e-3:
        print(f"the two identifications differ by {np.abs(apart).max():.4f} mm: nothing to compare")
        return False
    full, by_hand = (
        seconds(lambda: identify(dataset), 7),
        seconds(lambda: plain_gauss_newton(dataset), 7),
    )
    ratio = full / by_hand
    line(
        f"identification of {READINGS}: {1000 * full:.0f} ms, plain Gauss-Newton {1000 * by_hand:.0f} ms",
        f"{ratio:.2f} x",
        f"<= {WANTED:.0f}",
        ratio <= WANTED,
    )
    return ratio <= WANTED
