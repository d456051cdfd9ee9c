"""Benchmark of the direct kinematics of the ballbar hexapod: solutions per second.

They are counted in all assembly modes, alone and with covariance.
"""

from __future__ import annotations

import numpy as np

from calib.arm.hexapod import MODES, solve_pose
from tests.benchmarks.clock import line, seconds

WANTED_PER_S = 100_000
_SETS = 12_500


def run() -> bool:
    """Print solutions a second of processor time."""
    nominal = np.array([300.0] * 9 + [150.0] * 3)
    lengths = nominal + np.random.default_rng(1).uniform(-1.0, 1.0, (_SETS, 12))
    solved = _SETS * len(MODES)
    alone = solved / seconds(lambda: solve_pose(lengths).frames)
    line("hexapod: poses a second", f"{alone:,.0f}", f"{WANTED_PER_S:,}", alone > WANTED_PER_S)
    few = lengths[: _SETS // 10]
    both = solved / 10 / seconds(lambda: solve_pose(few).ball_covariance(0.001), tries=3)
    line("hexapod: poses a second, with the covariance of its balls", f"{both:,.0f}", "", reached=True)
    return alone > WANTED_PER_S
