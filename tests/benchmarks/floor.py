"""Benchmark of identification against the least error that the noise allows.

The error is taken against the truth, without its noise. At the measured poses, a fit of p parameters to n points
cannot do better than sigma sqrt(3) sqrt(p / 3n) on average, for any poses. At held-out poses, the floor depends on
the poses of the readings. It is the bound of Cramer and Rao, trace(G (J'J)^-1 G'), with J and G differences of the
second arm at the truth.
"""

from __future__ import annotations

import numpy as np

from calib.fit.identify import identify
from tests.benchmarks.clock import line
from tests.benchmarks.coverage import GROUPS, POINT_MM, Campaign, Kind, simulate, true_frames

WANTED = 0.05
"""Part by which the mean over all data sets may lie off its floor."""

_DIFFERENCE = 1e-6  # of the usual size of a parameter
_STILL = frozenset({"d3"})  # slides along the parallel axes as d2 does
_KINDS = tuple(
    Kind(f"{n} readings, {what}", n, groups=groups, fresh=100)
    for n in (50, 1000)
    for what, groups in (
        ("with beta", GROUPS),
        ("without beta", tuple(g for g in GROUPS if g != "parallel_twist")),
    )
)


def least_error(campaign: Campaign) -> float:
    """Least mean squared error at the validation rows, mm2."""
    conditions = campaign.data.conditions
    columns = []
    for name, value in campaign.truth.items():
        if name not in _STILL:
            step = _DIFFERENCE * (1e-6 if name.startswith("c") else 1.0)
            moved = true_frames(
                campaign.truth | {name: value + step},
                conditions.joints,
                conditions.target_names,
                conditions.target,
            )
            columns.append((moved[:, :3, 3] - campaign.positions) / step)
    derivative = np.stack(columns, axis=-1)
    fresh = campaign.data.validation_rows
    size = np.linalg.norm(derivative, axis=(0, 1))
    jacobian = (derivative[~fresh] / size).reshape(-1, len(size))
    spread = derivative[fresh] / size @ np.linalg.inv(np.linalg.qr(jacobian, mode="r"))
    return float(np.sum(spread**2, axis=(1, 2)).mean()) * POINT_MM**2


def study(kind: Kind, count: int) -> tuple[float, float]:
    """RMS error over its floor at measured and at fresh poses, over `count` data sets."""
    measured, fresh = [], []
    for seed in range(1, count + 1):
        campaign = simulate(kind, seed, _STILL)
        found = identify(campaign.data).predict(campaign.data.conditions)
        squared = np.sum((found - campaign.positions) ** 2, axis=1)
        rows = campaign.data.validation_rows
        free = len(campaign.truth) - len(_STILL)
        measured.append(float(squared[~rows].mean()) / (POINT_MM**2 * free / kind.readings))
        fresh.append(float(squared[rows].mean()) / least_error(campaign))
    return float(np.sqrt(np.mean(measured))), float(np.sqrt(np.mean(fresh)))


def run(count: int = 50) -> bool:
    """Print error over floor, with and without beta, for 50 and 1,000 readings."""
    reached = True
    for kind in _KINDS:
        for where, ratio in zip(("measured poses", "fresh poses"), study(kind, count), strict=True):
            good = abs(ratio - 1.0) <= WANTED
            line(f"error over its floor, {kind.name}: {where}", f"{ratio:.3f} x", f"1 +- {WANTED}", good)
            reached &= good
    return reached
