"""Test the compensation of joint targets.

These would catch: a correction applied the wrong way round or in the wrong frame, a base or tool that is omitted or
counted twice, and instrument effects that affect targets. They would also catch conditions that are not rebuilt
while the target moves, a branch or a limit that is not kept, singular targets that are driven, and rows that
influence each other. The landing is computed by another chain than the one that made the targets.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from calib import Correction, DataError, Robot, StatedConditions, correct, load_robot
from calib.arm import gravity_torques
from calib.arm.inverse_kinematics import nominal_inverse
from calib.array import Array
from calib.compensate import Status
from calib.model import FLANGE, ModelStructure, conditions_at
from calib.model.model import nominal_poses
from tests.calib.chain import chain
from tests.calib.errant import (
    ROBOT,
    STATED,
    TARGETS,
    WIDE,
    landing,
    random_targets,
    real_robot,
    wanted_poses,
)
from tests.calib.singular import least_singular_value


def miss_of(model: ModelStructure, estimate: Array, wanted: Array, done: Correction) -> Array:
    """Return flange errors of corrected targets, (k,), mm, relative to their goals."""
    reached = landing(model, estimate, done.joints[done.good])
    return np.linalg.norm(reached[:, :3, 3] - wanted[done.good][:, :3, 3], axis=1)


@pytest.mark.parametrize("seed", range(5))
def test_the_robot_lands_where_the_nominal_one_would(seed: int) -> None:
    model, estimate = real_robot(seed)
    targets = random_targets(200, seed)
    wanted = wanted_poses(targets)
    before = np.linalg.norm(landing(model, estimate, targets)[:, :3, 3] - wanted[:, :3, 3], axis=1)
    assert np.mean(before) > 0.5
    done = correct(model, estimate, targets, STATED, limits=WIDE)
    assert np.mean(done.good) >= 0.9  # the others are close to a stretched arm or wrist
    reached = landing(model, estimate, done.joints[done.good])
    assert np.max(miss_of(model, estimate, wanted, done)) < 2e-6
    assert np.max(np.abs(reached[:, :3, :3] - wanted[done.good][:, :3, :3])) < 1e-8


@pytest.mark.parametrize("seed", range(5))
def test_four_iterations_are_enough_for_98_percent(seed: int) -> None:
    model, estimate = real_robot(seed)
    targets = random_targets(1000, seed)
    done = correct(model, estimate, targets, STATED, most_iterations=4, limits=WIDE)
    fit = (
        least_singular_value(ROBOT, targets, np.zeros(3)) > 0.008
    )  # wrist 2.6 deg, elbow 4 deg from singular
    assert np.mean(fit) > 0.85
    assert np.mean(done.landed[fit] < 1e-6) >= 0.98
    assert np.mean(correct(model, estimate, targets[fit], STATED, limits=WIDE).good) > 0.98


def test_every_tool_target_is_carried_with_the_flange() -> None:
    model, estimate = real_robot(1)
    targets = random_targets(30, 1)
    for target, point in TARGETS.items():
        for aim in (FLANGE, target):
            done = correct(model, estimate, targets, STATED, target=aim, limits=WIDE)
            reached = landing(model, estimate, done.joints[done.good], point)
            wanted = np.array([chain(ROBOT, q, {}, target=point).real for q in targets[done.good]])
            assert np.max(np.abs(reached[:, :3, 3] - wanted[:, :3, 3])) < 2e-6, (target, aim)


def test_a_perfect_robot_needs_no_correction() -> None:
    model, estimate = real_robot(2)
    targets = random_targets(50, 2)
    done = correct(model, 0.0 * estimate, targets, STATED)
    good = done.good
    assert good.sum() > 40
    assert np.max(np.abs(done.joints[good] - targets[good])) < 1e-12
    assert not np.any(done.iterations)


def test_the_instrument_is_not_corrected_for() -> None:
    model, estimate = real_robot(3)
    still = np.array(
        [0.0 if p.name.startswith("drift") else x for p, x in zip(model.parameters, estimate, strict=True)]
    )
    assert not np.array_equal(still, estimate)
    targets = random_targets(40, 3)
    one, other = (correct(model, e, targets, STATED) for e in (estimate, still))
    np.testing.assert_array_equal(one.joints, other.joints)
    unstated = StatedConditions(side=1.0, temperature_c=23.5)  # no time: only the drift would need it
    np.testing.assert_array_equal(correct(model, estimate, targets, unstated).joints, one.joints)


def test_a_condition_that_the_model_needs_must_be_stated() -> None:
    model, estimate = real_robot(3)
    with pytest.raises(DataError, match=r"thermal_growth\.expansion"):
        correct(model, estimate, random_targets(3, 0), StatedConditions())
    assert correct(
        model.without("thermal_growth"),
        np.delete(estimate, model.index["thermal_growth.expansion"]),
        random_targets(3, 0),
        StatedConditions(),
        limits=WIDE,
    ).good.any()


def test_the_side_of_approach_decides() -> None:
    model, estimate = real_robot(4)
    targets = random_targets(40, 4)
    from_below = correct(model, estimate, targets, STATED, limits=WIDE)
    from_above = correct(
        model, estimate, targets, StatedConditions(side=(1, 1, 1, -1, 1, 1), temperature_c=23.5), limits=WIDE
    )
    both = from_below.good & from_above.good
    difference = np.degrees(from_above.joints - from_below.joints)[both]
    assert np.allclose(difference[:, 3], 0.03, atol=2e-4)  # the whole gap, on that joint
    assert np.max(np.abs(difference[:, [0, 1, 2, 4, 5]])) < 2e-4


def test_batched_equals_one_by_one() -> None:
    model, estimate = real_robot(5)
    targets = random_targets(25, 5)
    targets[3, 4] = 0.0  # a refused one must not disturb its neighbours
    together = correct(model, estimate, targets, STATED)
    for i, target in enumerate(targets):
        alone = correct(model, estimate, target[None], STATED)
        assert alone.status[0] is together.status[i]
        np.testing.assert_allclose(alone.joints[0], together.joints[i], rtol=0.0, atol=1e-12)


def test_no_targets_at_all() -> None:
    model, estimate = real_robot(5)
    done = correct(model, estimate, np.zeros((0, 6)), STATED)
    assert done.joints.shape == (0, 6)
    assert done.status == ()


@pytest.mark.parametrize("degrees", [-0.5, 0.0, 0.3])
def test_singular_wrist_is_refused(degrees: float) -> None:
    model, estimate = real_robot(6)
    targets = random_targets(20, 6)
    targets[:, 4] = np.radians(degrees)
    done = correct(model, estimate, targets, STATED)
    assert set(done.status) == {Status.SINGULAR}
    assert np.all(np.isnan(done.joints))
    assert all("singular" in reason for reason in done.reasons)


def test_branch_is_kept() -> None:
    model, estimate = real_robot(8)
    targets = random_targets(300, 8)
    done = correct(model, estimate, targets, STATED, limits=WIDE)
    moved = np.abs(done.joints - targets)[done.good]
    assert np.degrees(np.max(moved)) < 30.0
    assert np.all(np.sign(done.joints[done.good][:, 4]) == np.sign(targets[done.good][:, 4]))


def test_limits_are_kept() -> None:
    model, estimate = real_robot(9)
    targets = random_targets(100, 9)
    free = correct(model, estimate, targets, STATED, limits=WIDE)
    limits = np.column_stack([targets.min(axis=0), targets.max(axis=0)])
    tight = correct(model, estimate, targets, STATED, limits=limits)
    beyond = free.good & np.any((free.joints < limits[:, 0]) | (free.joints > limits[:, 1]), axis=1)
    assert beyond.any()
    assert [s is Status.BEYOND_LIMITS for s in tight.status] == list(beyond)
    assert np.all(np.isnan(tight.joints[beyond]))
    inside = tight.joints[tight.good]
    assert np.all((inside >= limits[:, 0]) & (inside <= limits[:, 1]))


def test_a_wild_model_is_refused_not_driven() -> None:
    model, estimate = real_robot(10)
    wild = estimate.copy()
    wild[model.index["theta2"]] = np.radians(40.0)
    done = correct(model, wild, random_targets(20, 10), STATED)
    assert not done.good.any()
    assert np.all(np.isnan(done.joints))


def test_a_free_world_corrects_relative_to_its_own_base() -> None:
    """The base pose that a fit found in the tracker's world does not affect the targets."""
    model, estimate = real_robot(11)
    of_base = [model.index[f"base.{axis}"] for axis in ("x", "y", "z", "rx", "ry", "rz")]
    at_home = estimate.copy()
    at_home[of_base] = 0.0
    targets = random_targets(20, 11)
    placement = chain(ROBOT, np.zeros(6), {"base.x": 900.0, "base.rz": 1.0}).real
    free = ModelStructure(ROBOT, model.effects, model.targets, {"main": placement}, model.station)
    np.testing.assert_allclose(
        correct(free, estimate, targets, STATED).joints,
        correct(model, at_home, targets, STATED).joints,
        atol=1e-12,
    )


@pytest.mark.parametrize("name", ["abb-irb120", "fanuc-lrmate200ic", "ur5", "ur10"])
def test_inverse_finds_the_joints_of_a_pose(name: str) -> None:
    robot = load_robot(name)
    rng = np.random.default_rng(1)
    joints = rng.uniform(-1.4, 1.4, (100, 6))
    joints[:, 4] = rng.choice((-1, 1), 100) * rng.uniform(0.3, 1.4, 100)
    joints[:, 2] = rng.uniform(0.4, 1.2, 100)  # away from the stretched arm
    tool = np.array([10.0, -20.0, 130.0])
    found = nominal_inverse(robot, nominal_poses(_bare(robot), joints, tool), joints + 0.005, tool)
    assert np.max(np.abs(found - joints)) < 1e-9


def _bare(robot: Robot) -> ModelStructure:
    return ModelStructure(robot, (), {"main": {}})


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"joints": np.zeros((3, 5))}, r"shape \(3, 5\)"),
        ({"target": "T9"}, "target 'T9'"),
        ({"limits": np.zeros((5, 2))}, "limits"),
        ({"stated": StatedConditions(side=(1.0, 1.0))}, "side"),
        ({"stated": StatedConditions(side=0.5)}, "side"),
        ({"stated": StatedConditions(series="night")}, "series 'night'"),
    ],
)
def test_wrong_arguments_are_named(change: dict[str, Any], what: str) -> None:
    model, estimate = real_robot(0)
    arguments: dict[str, Any] = {"joints": random_targets(2, 0), "stated": STATED} | change
    with pytest.raises(ValueError, match=what):
        correct(model, estimate, arguments.pop("joints"), arguments.pop("stated"), **arguments)


def test_conditions_follow_the_joints_and_keep_what_was_stated() -> None:
    model, _ = real_robot(0)
    joints = random_targets(4, 0)
    got = conditions_at(model, joints, StatedConditions(side=-1.0, temperature_c=25.0))
    np.testing.assert_array_equal(got.torque, gravity_torques(ROBOT, joints))
    np.testing.assert_allclose(got.previous - joints, np.radians(5.0))
    assert np.all(got.side == -1.0)
    assert np.all(got.temperature == 25.0)
