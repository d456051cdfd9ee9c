"""The error at the check poses, and its U against drawn noise and drawn frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.fit import identify
from calib.saved import as_saved
from calib.units import DEG
from calib.watch import WhitenedReadings, missed
from calib.watch.whitened_readings import frame_covariance
from tests.benchmarks.coverage import KINDS, simulate

DRAWS = 200


@pytest.mark.parametrize("name", ["points", "distances"])
def test_u_is_what_noise_and_frame_do_to_the_rms(name: str) -> None:
    kind = next(kind for kind in KINDS if kind.name == name)
    data = simulate(kind, 3).data
    status = np.full(len(data), "rejected:not visited")
    status[np.flatnonzero(data.fit_rows)[:20]] = "ok"
    nests = {"N1": (400.0, -300.0, 0.0), "N2": (400.0, 300.0, 0.0), "N3": (900.0, 0.0, 100.0)}
    baseline = as_saved(identify(data))
    joints = data.conditions.joints - np.array(
        [0.0, 0.0, 0.08 * DEG, 0.0, 0.0, 0.0]
    )  # a change, so that it misses
    data = replace(
        data,
        status=status,
        conditions=replace(data.conditions, joints=joints),
        header=replace(data.header, nests=nests),
    )
    seen = WhitenedReadings.of(baseline, data)
    found = missed(seen, data)
    noise, rng, drawn = data.header.noise, np.random.default_rng(1), []
    frame = frame_covariance(nests, noise, seen.model.station)
    scatter = noise.of_points(data.points, data.u_point)
    for _ in range(DRAWS):
        shift, turn = np.split(rng.multivariate_normal(np.zeros(6), frame), 2)
        about = np.array(seen.model.station)
        points = Rotation.from_rotvec(turn).apply(data.points - about) + about + shift
        points = points + np.einsum("nij,nj->ni", np.linalg.cholesky(scatter), rng.normal(size=points.shape))
        lengths = data.lengths + noise.length_mm * rng.normal(size=len(data))
        drawn.append(missed(seen, replace(data, points=points, lengths=lengths)).rms)
    assert found.n == 20
    assert found.max > found.rms > 0.1
    assert found.u == pytest.approx(2.0 * float(np.std(drawn)), rel=0.15)
