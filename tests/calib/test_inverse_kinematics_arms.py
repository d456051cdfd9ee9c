"""Test inverse kinematics of other arms than six axes with a wrist.

These would catch: a branch that is missed or found twice, joints that do not reach the pose, and a wrong order or
sense of axes. They would also catch a track that moves, an elbow that leaves its half-plane, and a pose that the
arm cannot tilt to but that is reported as reached.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from calib.arm.inverse_kinematics import (
    BranchResult,
    arm_of,
    inverse_kinematics,
    nearest_branch,
    within_limits,
)
from calib.arm.kinematics import forward
from calib.arm.robot import Convention, Robot, load_robot
from calib.array import Array
from calib.errors import DataError
from tests.calib.level import built, random_postures

RIGHT = np.pi / 2.0


def arm(
    convention: Convention, alpha: list[float], a: list[float], d: list[float], slides: tuple[int, ...] = ()
) -> Robot:
    """A robot of any number of axes, without loads."""
    n = len(alpha)
    return replace(
        load_robot("abb-irb120"),
        name="made up",
        convention=convention,
        base="plain",
        alpha=tuple(alpha),
        a=tuple(a),
        d=tuple(d),
        theta=(0.0,) * n,
        lower=(-3.0,) * n,
        upper=(3.0,) * n,
        parallel_axes=(),
        loads=(),
        capsules=(),
        slides=slides,
    )


CRX = arm("mdh", [0, -RIGHT, 0, -RIGHT, RIGHT, -RIGHT], [0, 0, 540, 0, 0, 0], [245, 0, 0, 540, -150, 160])
XARM = arm("mdh", [0, -RIGHT, 0, -RIGHT, RIGHT, -RIGHT], [0, 50, 284, 77, 0, 76], [267, 0, 0, 342, 0, 97])


def apart(robot: Robot, one: Array, other: Array) -> Array:
    """Largest difference of joints, rad or mm, whole turns left out."""
    off = one - other
    turns = np.array(robot.kinds) == "turns"
    return np.max(np.abs(off - 2.0 * np.pi * np.round(np.where(turns, off, 0.0) / (2.0 * np.pi))), axis=-1)


def judged(robot: Robot, joints: Array, *, missed: float = 0.0) -> NDArray[np.bool_]:
    """Mask the valid branches of the poses of `joints`, (n, B).

    All of them reach the pose, and the given joints are among them.
    """
    poses = forward(robot, joints)
    found = inverse_kinematics(robot, poses, seed=joints)
    own = np.where(found.valid, apart(robot, found.joints, joints[:, None]), np.inf)
    assert np.mean(np.min(own, axis=1) > 1e-7) <= missed
    rows, _ = np.nonzero(found.valid)
    again = forward(robot, found.joints[found.valid])
    assert np.max(np.linalg.norm((again - poses[rows])[:, :3, 3], axis=1)) < 1.1e-9
    assert np.max(np.abs((again - poses[rows])[:, :3, :3])) < 1e-11
    for row in range(0, len(joints), len(joints) // 20):  # no solution twice
        there = found.joints[row][found.valid[row]]
        pairs = apart(robot, there[:, None], there[None]) + np.eye(len(there))
        assert np.min(pairs) > 1e-6
    return found.valid


@pytest.mark.parametrize("name", ["scara", "scara-dh", "palletizer", "seven", "track"])
def test_no_branch_is_missed_and_every_solution_stands_in_the_pose(name: str, tmp_path: Path) -> None:
    robot, coupling = built(name, tmp_path)
    valid = judged(robot, random_postures(robot, coupling, 2000, 1))
    assert valid.shape[1] == {"palletizer": 4, "seven": 8, "track": 8}.get(name, 2)
    assert np.all(valid.sum(axis=1) >= 2)


@pytest.mark.parametrize("robot", [CRX, XARM], ids=["crx", "xarm"])
def test_a_wrist_that_is_not_in_a_point_is_searched_through(robot: Robot) -> None:
    """A search finds the branches of a wrist whose axes do not meet.

    It may miss a pair of branches that lie close together, for one pose in a hundred at most.
    """
    joints = np.random.default_rng(1).uniform(-np.pi, np.pi, (300, 6))
    assert judged(robot, joints, missed=0.01).sum(axis=1).max() > 8


@given(st.integers(0, 2**32 - 1), st.permutations([1, 2, 3, 4]), st.sampled_from(["mdh", "dh"]))
def test_every_order_and_sense_of_a_scara(seed: int, order: list[int], convention: Convention) -> None:
    rng = np.random.default_rng(seed)
    alpha = [0.0, *rng.choice([0.0, np.pi], 3)]
    a, d = rng.uniform(100.0, 400.0, (2, 4))
    robot = arm(convention, alpha, list(a), list(d), slides=(order[0],))
    judged(robot, rng.uniform(-2.5, 2.5, (40, 4)))


@given(st.integers(0, 2**32 - 1))
def test_every_sense_of_five_axes(seed: int) -> None:
    rng = np.random.default_rng(seed)
    a, d = rng.uniform(50.0, 400.0, (2, 5))
    alpha = [0.0, rng.choice([-1, 1]) * RIGHT, *rng.choice([0.0, np.pi], 2), rng.choice([-1, 1]) * RIGHT]
    judged(arm("mdh", alpha, list(a), list(d)), rng.uniform(-np.pi, np.pi, (40, 5)))


def test_right_and_left_are_those_of_a_person_seen_from_above(tmp_path: Path) -> None:
    robot, _ = built("scara", tmp_path)
    found = inverse_kinematics(robot, forward(robot, np.array([[0.0, 0.9, -50.0, 0.0]])))
    assert arm_of(robot).branches == ("right", "left")
    assert found.joints[0, 0, 1] == pytest.approx(0.9)
    assert found.joints[0, 1, 1] == pytest.approx(-0.9)


def test_a_pose_that_the_arm_cannot_tilt_to(tmp_path: Path) -> None:
    for name in ("scara", "palletizer"):
        robot, coupling = built(name, tmp_path)
        poses = forward(robot, random_postures(robot, coupling, 3, 2))
        tilt = np.eye(4)
        tilt[1:3, 1:3] = [[np.cos(0.1), -np.sin(0.1)], [np.sin(0.1), np.cos(0.1)]]
        found = inverse_kinematics(robot, poses @ tilt)
        assert set(found.all_of(0)) <= {BranchResult.TILTED, BranchResult.TOO_FAR, BranchResult.TOO_NEAR}
        assert not found.valid.any()


def test_a_track_stays_where_it_stands(tmp_path: Path) -> None:
    robot, _ = built("track", tmp_path)
    joints = random_postures(robot, "none", 50, 3)
    seed = joints.copy()
    seed[:, 0] += 100.0
    found = inverse_kinematics(robot, forward(robot, joints), seed=seed)
    assert np.all(found.joints[found.valid][:, 0] == np.repeat(seed[:, 0], found.valid.sum(axis=1)))
    assert found.valid.any(axis=1).mean() > 0.9


def test_the_elbow_stays_in_its_half_plane(tmp_path: Path) -> None:
    """For every branch, the elbow stays in its half-plane about the line from shoulder to wrist.

    The poses are near the taught posture.
    """
    robot, _ = built("seven", tmp_path)
    taught = random_postures(robot, "none", 200, 4)
    poses = forward(robot, taught + np.random.default_rng(5).uniform(-0.1, 0.1, taught.shape))
    found = inverse_kinematics(robot, poses, seed=taught)
    rows, _ = np.nonzero(found.valid)
    shoulder = np.array([0.0, 0.0, robot.d[0]])
    wrist = poses[rows, :3, 3] - robot.d[6] * poses[rows, :3, 2] - shoulder
    across = np.cross(wrist, _elbow(robot, found.joints[found.valid]) - shoulder)
    before = np.cross(wrist, _elbow(robot, taught[rows]) - shoulder)
    size = np.linalg.norm(across, axis=1) * np.linalg.norm(before, axis=1)
    assert np.min(np.sum(across * before, axis=1) / size) > 1.0 - 1e-9


def _elbow(robot: Robot, joints: Array) -> Array:
    """Compute the crossing of axes 4 and 3, (n, 3), mm: 400 mm from the shoulder on axis 3."""
    first, second = joints[:, 0], joints[:, 1]
    along = [np.cos(first) * np.sin(second), np.sin(first) * np.sin(second), np.cos(second)]
    return np.array([0.0, 0.0, robot.d[0]]) + robot.d[2] * np.array(along).T


def test_all_reachable_poses_of_seven_axes_are_solved_from_a_seed_far_away(tmp_path: Path) -> None:
    robot, _ = built("seven", tmp_path)
    joints = random_postures(robot, "none", 1000, 6)
    found = inverse_kinematics(robot, forward(robot, joints), seed=random_postures(robot, "none", 1000, 7))
    assert np.mean(found.valid.any(axis=1)) >= 0.99


def test_a_slide_has_no_turns(tmp_path: Path) -> None:
    """Limits and seed of a slide are mm: 6.28 of them are no turn."""
    robot, _ = built("scara", tmp_path)
    joints = random_postures(robot, "none", 100, 8)
    seed = joints + np.array([0.0, 0.0, 60.0, 0.0])
    solved = inverse_kinematics(robot, forward(robot, joints)).joints
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    found = within_limits(solved, seed[:, None], lower, upper, slides=robot.slides)
    branch = nearest_branch(found, seed)
    np.testing.assert_allclose(found[np.arange(100), branch], joints, atol=1e-8)
    assert np.all(branch >= 0)
    lower[2], upper[2] = -400.0, -300.0
    assert np.all(np.isnan(within_limits(solved, seed[:, None], lower, upper, slides=robot.slides)))


@pytest.mark.parametrize(
    ("robot", "what"),
    [
        (arm("mdh", [0, 0.1, 0, 0], [0, 300, 200, 0], [0] * 4, slides=(3,)), "axes 1 and 2 are not parallel"),
        (arm("mdh", [0, 0, 0, 0], [0, 300, 0, 0], [0] * 4, slides=(4,)), "parallel axes coincide"),
        (arm("mdh", [0, 0, 0, 0], [0, 300, 200, 0], [0] * 4), "of which 4 turn"),
        (
            arm("mdh", [0, RIGHT, 0, 0.1, RIGHT], [0, 9, 300, 300, 0], [0] * 5),
            "axes 3 and 4 are not parallel",
        ),
        (
            arm("mdh", [0, -RIGHT, RIGHT, RIGHT, -RIGHT, -RIGHT, RIGHT], [0, 0, 0, 0, 0, 0, 88], [300.0] * 7),
            "pass|passes",
        ),
        (arm("mdh", [0, -RIGHT], [0, 0], [0, 0]), "2 joints"),
    ],
)
def test_other_arms_are_refused_by_what_is_in_the_way(robot: Robot, what: str) -> None:
    with pytest.raises(DataError, match=what):
        arm_of(robot)
