"""Benchmark of identification: processor time against two plain programs, in turns.

1,000 readings must take at most 3 times as long as a plain Gauss-Newton on the same columns. 50 readings must take
at most 2 times as long as a program written by hand for this one robot (`by_hand`).

The plain version is written as by hand: nominal start, whitened residual, columns from the same batched chain, and
`numpy.linalg.lstsq`, until the step no longer counts. It is not robust, has no prior and finds no redundancy. It
takes the model, the whitening and the noise for granted.
"""

from __future__ import annotations

import tempfile
import time
from pathlib import Path

import numpy as np

from calib import Dataset, identify, read_dataset
from calib.array import Array
from calib.fit import base_model_of, readings_of
from calib.fit.least_squares import jacobian
from calib.model import BoundModel
from mocks.campaign import make_campaign, write_campaign
from tests.benchmarks.by_hand import identify_by_hand
from tests.benchmarks.clock import line, seconds

READINGS = 1000
WANTED = 3.0
FEW, TWICE = 50, 2.0
_TURNS = 60


def plain_gauss_newton(dataset: Dataset) -> Array:
    """Estimate (m,) of the base model by plain least squares."""
    model = base_model_of(dataset)
    estimate = np.zeros(len(model.parameters))
    readings = readings_of(dataset, dataset.fit_rows, model, estimate)
    design = BoundModel(model, readings.conditions)
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


def drawn(readings: int) -> Dataset:
    """A data set that lacks nothing, through its files."""
    with tempfile.TemporaryDirectory() as folder:
        campaign = make_campaign(seed=1, n=readings, n_validation=0, effects=[])
        return read_dataset(write_campaign(campaign, Path(folder))["csv"])


def run() -> bool:
    """Print both ratios, after making sure that all find the same robot."""
    return all([beside_plain(), beside_by_hand()])


def beside_by_hand() -> bool:
    """Fifty readings: ours over the version written by hand. Least times of many turns, since machines are busy."""
    dataset = drawn(FEW)
    ours, (_, points) = identify(dataset), identify_by_hand(dataset)
    apart = np.abs(ours.predict(dataset.conditions.take(dataset.fit_rows)) - points).max()
    if apart > 2e-3:
        print(f"the two identifications differ by {apart:.4f} mm: nothing to compare")
        return False
    least = {identify: np.inf, identify_by_hand: np.inf}
    for _ in range(_TURNS):
        for one in least:
            begin = time.process_time()
            one(dataset)
            least[one] = min(least[one], time.process_time() - begin)
    full, by_hand = least[identify], least[identify_by_hand]
    name = f"identification of {FEW}: {1000 * full:.1f} ms, written by hand {1000 * by_hand:.1f} ms"
    line(name, f"{full / by_hand:.2f} x", f"<= {TWICE:.0f}", full <= TWICE * by_hand)
    return full <= TWICE * by_hand


def beside_plain() -> bool:
    """A thousand readings: ours over a plain Gauss-Newton on our own chain."""
    dataset = drawn(READINGS)
    ours, plain = identify(dataset), plain_gauss_newton(dataset)
    conditions = dataset.conditions
    apart = ours.predict(conditions) - BoundModel(ours.model, conditions).predict(plain)
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
