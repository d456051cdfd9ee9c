"""Pose targets, controllers that count otherwise, and the inverse direction. These would catch: a pose corrected in
another branch or turn than asked for, a tool applied on the wrong side, a limit judged in the wrong angles, a target
out of reach that is driven, and an inverse direction that is not the inverse.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from calib import DataError, Robot, StatedConditions, correct, forward, load_robot
from calib.arm import BRANCHES
from calib.array import Array
from calib.compensate import Status, correct_poses, model_sides, nominal_of, postures_of
from calib.validation.branch import branches
from tests.calib.errant import ROBOT, STATED, WIDE, landing, only_geometry, random_targets, real_robot

TOOL = np.array(
    [[0.0, 0.0, 1.0, 30.0], [0.0, 1.0, 0.0, -40.0], [-1.0, 0.0, 0.0, 160.0], [0.0, 0.0, 0.0, 1.0]]
)


def names_of(robot: Robot, joints: Array) -> list[str]:
    names = branches(robot, joints)
    assert names is not None
    return names


@pytest.mark.parametrize("seed", range(3))
def test_the_tool_lands_in_the_poses_that_were_asked_for(seed: int) -> None:
    model, estimate = real_robot(seed)
    joints = random_targets(300, seed)
    wanted = forward(ROBOT, joints) @ TOOL
    done = correct_poses(model, estimate, wanted, STATED, branch=names_of(ROBOT, joints), tool=TOOL)
    good = done.correction.good
    assert np.mean(good) > 0.85
    reached = landing(model, estimate, done.correction.joints[good]) @ TOOL
    assert np.max(np.linalg.norm((reached - wanted[good])[:, :3, 3], axis=1)) < 2e-6
    assert np.max(np.abs((reached - wanted[good])[:, :3, :3])) < 1e-8
    # The pose to be sent is the one that a nominal controller turns into those joints, in the same branch.
    sent, branch = postures_of(
        ROBOT, done.poses[good] @ np.linalg.inv(TOOL), branch=[BRANCHES[k] for k in done.branch[good]]
    )
    np.testing.assert_allclose(sent, done.correction.joints[good], atol=1e-9)
    np.testing.assert_array_equal(branch, done.branch[good])
    assert np.all(np.isnan(done.poses[~good]))


@pytest.mark.parametrize("name", ["abb-irb120", "fanuc-lrmate200ic", "ur5", "ur10"])
def test_98_percent_within_a_nanometre_after_four_iterations_and_all_in_the_end(name: str) -> None:
    robot = load_robot(name)
    model, estimate = only_geometry(robot, 3)
    joints = np.random.default_rng(2).uniform(-2.0, 2.0, (1000, 6))
    poses, asked = forward(robot, joints), names_of(robot, joints)
    limits = np.tile([-10.0, 10.0], (6, 1))
    done = correct_poses(model, estimate, poses, StatedConditions(), branch=asked, limits=limits)
    good = done.correction.good
    assert np.mean(good) > 0.85
    assert np.max(done.correction.landed[good]) <= 1e-6
    after_four = correct(model, estimate, joints[good], StatedConditions(), limits=limits, most_iterations=4)
    assert np.mean(after_four.landed <= 1e-6) >= 0.98


def test_without_branches_the_nearest_to_the_seed_is_meant() -> None:
    model, estimate = real_robot(1)
    joints = random_targets(100, 1)
    poses = forward(ROBOT, joints)
    named = correct_poses(model, estimate, poses, STATED, branch=names_of(ROBOT, joints), seed=joints)
    near = correct_poses(model, estimate, poses, STATED, seed=joints + 0.01)
    np.testing.assert_array_equal(near.branch, named.branch)
    np.testing.assert_allclose(near.correction.joints, named.correction.joints, atol=1e-8)


def test_turns_follow_the_seed() -> None:
    joints = random_targets(20, 2)
    seed = joints + np.radians([0.0, 0.0, 0.0, 0.0, 0.0, 300.0])
    found, _ = postures_of(ROBOT, forward(ROBOT, joints), branch=names_of(ROBOT, joints), seed=seed)
    turned = joints[:, 5] + 2.0 * np.pi
    inside = turned <= ROBOT.upper[5]
    assert inside.any()
    assert not inside.all()
    np.testing.assert_allclose(found[:, 5], np.where(inside, turned, joints[:, 5]), atol=1e-8)


def test_out_of_reach_is_refused_and_leaves_the_others_alone() -> None:
    model, estimate = real_robot(3)
    joints = random_targets(10, 3)
    poses, asked = forward(ROBOT, joints), names_of(ROBOT, joints)
    far = poses.copy()
    far[4, :3, 3] *= 10.0
    one = correct_poses(model, estimate, poses, STATED, branch=asked)
    other = correct_poses(model, estimate, far, STATED, branch=asked)
    assert other.correction.status[4] is Status.OUT_OF_REACH
    assert "does not reach" in other.correction.reasons[4]
    assert other.branch[4] == -1
    rest = np.arange(10) != 4
    np.testing.assert_array_equal(other.correction.joints[rest], one.correction.joints[rest])


def test_limits_are_judged_as_the_controller_counts() -> None:
    """LR Mate: J3 counts from the horizontal; model theta_3 = -(J2 + J3)."""
    robot = load_robot("fanuc-lrmate200ic")
    model, estimate = only_geometry(robot, 1)
    counted = np.radians([[10.0, 100.0, 60.0, 20.0, -50.0, 30.0]])
    joints = robot.model_angles(counted, "fanuc-j23")
    assert joints[0, 2] < robot.lower[2]  # taken for model angles it would be beyond
    refused = correct(model, estimate, joints, StatedConditions())
    assert refused.status == (Status.BEYOND_LIMITS,)
    done = correct(model, estimate, joints, StatedConditions(), coupling="fanuc-j23")
    assert done.good.all()
    np.testing.assert_allclose(robot.controller_angles(done.joints, "fanuc-j23"), counted, atol=0.01)
    posed = correct_poses(
        model,
        estimate,
        forward(robot, joints),
        StatedConditions(),
        branch=names_of(robot, joints),
        coupling="fanuc-j23",
    )
    np.testing.assert_allclose(posed.correction.joints, done.joints, atol=1e-9)


def test_sides_of_a_coupled_joint() -> None:
    robot = load_robot("fanuc-lrmate200ic")
    assert list(model_sides(robot, np.ones(6), "fanuc-j23")) == [1, 1, -1, -1, -1, -1]
    assert list(model_sides(robot, -np.ones(6), "none")) == [-1] * 6
    with pytest.raises(ValueError, match="joint 3"):
        model_sides(robot, np.array([1.0, 1.0, -1.0, 1.0, 1.0, 1.0]), "fanuc-j23")


def test_the_inverse_direction_is_the_inverse() -> None:
    model, estimate = real_robot(4)
    driven = random_targets(200, 4)
    shown = nominal_of(model, estimate, driven, STATED, limits=WIDE)
    assert np.mean(shown.good) > 0.85
    stands = landing(model, estimate, driven[shown.good])
    np.testing.assert_allclose(forward(ROBOT, shown.joints[shown.good]), stands, atol=1e-8)
    back = correct(model, estimate, shown.joints[shown.good], STATED, limits=WIDE)
    np.testing.assert_allclose(back.joints[back.good], driven[shown.good][back.good], atol=1e-6)
    assert np.mean(back.good) > 0.95


def test_the_inverse_direction_refuses_too() -> None:
    model, estimate = real_robot(5)
    joints = random_targets(3, 5)
    joints[0, 4] = 0.0
    joints[1, 0] = ROBOT.upper[0] + 0.1
    joints[2] = np.nan
    done = nominal_of(model, estimate, joints, STATED)
    assert done.status == (Status.SINGULAR, Status.BEYOND_LIMITS, Status.OUT_OF_REACH)
    assert np.all(np.isnan(done.joints))


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({}, "branch of every pose or a seed"),
        ({"branch": ["front/up/noflip"]}, "1 branches for 2"),
        ({"branch": ["front/up/noflip", "left"]}, "'left'"),
        ({"seed": np.zeros((2, 5))}, "seed has shape"),
    ],
)
def test_wrong_arguments_are_named(change: dict[str, Any], what: str) -> None:
    model, estimate = real_robot(0)
    with pytest.raises(ValueError, match=what):
        correct_poses(model, estimate, forward(ROBOT, random_targets(2, 0)), STATED, **change)


def test_a_robot_without_closed_form_takes_joint_targets_only() -> None:
    model, estimate = real_robot(0)
    odd = replace(model, robot=replace(ROBOT, alpha=(*ROBOT.alpha[:2], 0.01, *ROBOT.alpha[3:])))
    joints = random_targets(2, 0)
    assert correct(odd, estimate, joints, STATED, limits=WIDE).good.any()
    with pytest.raises(DataError, match="closed form"):
        correct_poses(odd, estimate, forward(ROBOT, joints), STATED, seed=joints)
