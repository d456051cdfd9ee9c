"""Test the coverage of intervals on few campaigns.

These would catch standard errors and predicted uncertainties that are too small or too large. Causes are a prior
that weighs twice, a declared uncertainty that is forgotten, a scale that is applied to the wrong part, or a
Jacobian that is nearly right. `python -m tests.benchmarks coverage` does it with 300 campaigns of every kind.
"""

from __future__ import annotations

import numpy as np
import pytest
from scipy.stats import binom

from calib.arm.kinematics import gravity_torques
from calib.arm.robot import load_robot
from tests.benchmarks.arm import tool_frames, torques
from tests.benchmarks.coverage import KINDS, Kind, simulate, study
from tests.calib.chain import chain

CAMPAIGNS = 40
A_CAMPAIGN = 8
"""So many independent looks a campaign: its parameters and positions are correlated."""


@pytest.mark.parametrize("robot", ["abb-irb120", "ur10"])
def test_the_second_arm_is_the_third(robot: str) -> None:
    """Matrices over all poses against matrices one by one, every slot of base and links moved."""
    rng = np.random.default_rng(1)
    arm = load_robot(robot)
    joints = rng.uniform(-2.0, 2.0, (5, 6))
    names = [f"{kind}{k}" for k in range(1, 7) for kind in ("alpha", "beta", "a", "theta", "d")]
    names += [f"base.{k}" for k in ("x", "y", "z", "rx", "ry", "rz")]
    add = dict(zip(names, rng.uniform(-0.3, 0.3, len(names)), strict=True))
    targets = rng.uniform(-100.0, 100.0, (5, 3))
    frames = tool_frames(arm, joints, add, targets)
    for frame, angles, target in zip(frames, joints, targets, strict=True):
        np.testing.assert_allclose(frame, chain(arm, angles, add, target).real, rtol=0, atol=1e-10)
    np.testing.assert_allclose(torques(arm, joints), gravity_torques(arm, joints), rtol=0, atol=1e-6)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.name)
def test_95_percent_intervals_hold_the_truth_in_95_percent(kind: Kind) -> None:
    looks = CAMPAIGNS * A_CAMPAIGN
    low, high = binom.interval(0.999, looks, 0.95)
    for share in study(kind, CAMPAIGNS):
        assert low / looks <= share <= high / looks


def test_another_seed_is_another_robot() -> None:
    """Forty campaigns are forty, and each is made again to the last digit."""
    one, again, other = (simulate(KINDS[0], seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.data.points, again.data.points)
    assert np.abs(one.positions - other.positions).max() > 10.0
    assert len(set(one.truth.values()) & set(other.truth.values())) == 0
