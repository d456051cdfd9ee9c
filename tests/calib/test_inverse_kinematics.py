"""Test inverse kinematics in closed form.

These would catch: a branch that is missed or named otherwise than in `calib.validation.judge`, joints that do not
reach the pose, and a pose out of reach or singular that is not reported as such. They would also catch a turn
beyond a limit, a structure mistaken for another, and rows that influence each other.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calib import DataError, Robot, forward, inverse_kinematics, load_robot
from calib.arm import BRANCHES, BranchResult, nearest_branch, nearest_turns, within_limits
from calib.arm.inverse_kinematics import arm_of
from calib.arm.inverse_kinematics.six_axes import structure_of
from calib.arm.inverse_kinematics.zero_pose import ZeroPose
from calib.arm.robot import Convention
from calib.array import Array
from calib.validation.judge import branches
from tests.calib.chain import chain

NAMES = ("abb-irb120", "fanuc-lrmate200ic", "ur5", "ur10")
RIGHT = np.pi / 2.0
STRETCHED = -np.degrees(
    np.arctan2(302.0, 70.0)
)  # theta_3 of an IRB 120 with its wrist in line with the upper arm


def random_joints(n: int, seed: int) -> Array:
    return np.random.default_rng(seed).uniform(-np.pi, np.pi, (n, 6))


def apart(one: Array, other: Array) -> Array:
    """Largest difference of joint angles, whole turns left out."""
    return np.max(np.abs((one - other + np.pi) % (2.0 * np.pi) - np.pi), axis=-1)


@pytest.mark.parametrize("name", NAMES)
def test_no_branch_is_missed_and_every_solution_stands_in_the_pose(name: str) -> None:
    robot = load_robot(name)
    joints = random_joints(10_000, 1)
    poses = forward(robot, joints)
    found = inverse_kinematics(robot, poses)
    own = np.array([BRANCHES.index(b) for b in branches(robot, joints) or ()])
    rows = np.arange(len(joints))
    assert np.all(found.valid[rows, own])
    assert np.max(apart(found.joints[rows, own], joints)) < 1e-8
    again = forward(robot, found.joints[found.valid])
    wanted = poses[np.nonzero(found.valid)[0]]
    assert np.max(np.linalg.norm(again[:, :3, 3] - wanted[:, :3, 3], axis=1)) < 1e-9
    assert np.max(np.abs(again[:, :3, :3] - wanted[:, :3, :3])) < 1e-12
    assert branches(robot, found.joints[found.valid]) == [BRANCHES[k] for k in np.nonzero(found.valid)[1]]
    assert np.all(np.isnan(found.joints[~found.valid]))


def test_solutions_stand_in_the_pose_by_another_chain() -> None:
    robot = load_robot("fanuc-lrmate200ic")
    joints = np.radians([20.0, 30.0, -15.0, 40.0, 50.0, -60.0])
    found = inverse_kinematics(robot, chain(robot, joints, {}).real[None])
    assert list(found.valid[0]) == [True] * 4 + [False] * 4  # axis 2 stands before axis 1: not from behind
    for solution in found.joints[0, :4]:
        np.testing.assert_allclose(chain(robot, solution, {}).real, chain(robot, joints, {}).real, atol=1e-10)


def test_branches_are_where_the_words_say() -> None:
    """IRB 120: front is theta_2 leaning to the wrist in front, noflip a positive theta_5."""
    found = inverse_kinematics(load_robot("abb-irb120"), _pose(400.0, 50.0, 500.0))
    for k, name in enumerate(BRANCHES):
        q = found.joints[0, k]
        assert (abs(q[0]) < RIGHT) == name.startswith("front")
        assert (q[4] > 0.0) == name.endswith("/noflip")
    front_up, front_down = (
        found.joints[0, BRANCHES.index(f"front/{elbow}/noflip")] for elbow in ("up", "down")
    )
    robot = load_robot("abb-irb120")
    elbow_height = [290.0 + robot.a[2] * np.cos(q[1]) for q in (front_up, front_down)]
    assert elbow_height[0] > elbow_height[1]


def _pose(x: float, y: float, z: float) -> Array:
    """The flange looks down, somewhat turned."""
    pose = np.eye(4)
    pose[:3, :3] = [[0.0, 0.6, 0.8], [1.0, 0.0, 0.0], [0.0, 0.8, -0.6]]
    pose[:3, 3] = x, y, z
    return pose[None]


def test_a_pose_out_of_reach_says_so_in_every_branch() -> None:
    robot = load_robot("abb-irb120")
    found = inverse_kinematics(robot, np.vstack([_pose(400.0, 0.0, 400.0), _pose(4000.0, 0.0, 400.0)]))
    assert found.valid[0].all()
    assert not found.valid[1].any()
    assert set(found.all_of(1)) == {BranchResult.TOO_FAR}
    assert np.all(np.isnan(found.joints[1]))
    assert np.isfinite(found.joints[0]).all()


def test_some_branches_of_a_pose_may_be_out_of_reach() -> None:
    robot = load_robot("fanuc-lrmate200ic")  # axis 2 stands 75 mm before axis 1
    found = inverse_kinematics(robot, forward(robot, np.radians([[0.0, 60.0, -40.0, 10.0, 50.0, 0.0]])))
    assert list(found.valid[0]) == [True] * 4 + [False] * 4
    assert found.all_of(0)[5] is BranchResult.TOO_FAR


def test_within_its_shoulder_offset_a_ur_does_not_reach() -> None:
    robot = load_robot("ur5")
    pose = forward(robot, np.radians([[0.0, -90.0, 90.0, 0.0, 90.0, 0.0]]))
    wrist_to_axis = np.hypot(*(pose[0, :2, 3] - robot.d[5] * pose[0, :2, 2]))
    pose[0, :2, 3] += (pose[0, :2, 3] - robot.d[5] * pose[0, :2, 2]) * (80.0 / wrist_to_axis - 1.0)
    found = inverse_kinematics(robot, pose)
    assert set(found.all_of(0)) == {BranchResult.TOO_NEAR}


@pytest.mark.parametrize(
    ("name", "degrees", "what"),
    [
        ("abb-irb120", [10.0, 20.0, 30.0, 40.0, 0.0, 60.0], BranchResult.WRIST),
        ("ur5", [10.0, -80.0, 70.0, 40.0, 0.0, 60.0], BranchResult.WRIST),
        ("ur5", [10.0, -80.0, 0.0, 40.0, 50.0, 60.0], BranchResult.ELBOW),
        ("abb-irb120", [10.0, 20.0, STRETCHED, 40.0, 50.0, 60.0], BranchResult.ELBOW),
    ],
)
def test_a_singular_pose_says_so_and_is_still_solved(
    name: str, degrees: list[float], what: BranchResult
) -> None:
    robot = load_robot(name)
    joints = np.radians([degrees])
    pose = forward(robot, joints)
    (own,) = (BRANCHES.index(b) for b in branches(robot, joints + 1e-9) or ())
    found = inverse_kinematics(robot, pose, seed=joints)
    assert found.all_of(0)[own] is what
    for solution in found.joints[0][found.valid[0]]:
        np.testing.assert_allclose(forward(robot, solution[None]), pose, atol=1e-7)
    if what is BranchResult.WRIST:  # the free joint is the seed's
        assert apart(found.joints[0, own], joints[0]) < 1e-7


def test_above_axis_1_the_shoulder_is_singular_and_theta_1_the_seeds() -> None:
    robot = load_robot("abb-irb120")
    bend = -1.0
    reach = np.array([302.0 * np.cos(bend) + 70.0 * np.sin(bend), 70.0 * np.cos(bend) - 302.0 * np.sin(bend)])
    # theta_2 that brings the wrist centre above axis 1
    joints = np.array([[0.7, -np.arctan2(reach[0], 270.0 + reach[1]), bend, 0.4, 0.8, 0.1]])
    pose = forward(robot, joints)
    wrist = pose[0, :3, 3] - 72.0 * pose[0, :3, 2]
    assert np.hypot(wrist[0], wrist[1]) < 1e-9
    found = inverse_kinematics(robot, pose, seed=joints)
    assert set(found.all_of(0)) == {BranchResult.SHOULDER}
    assert np.min(apart(found.joints[0], joints)) < 1e-7


def test_batched_equals_one_by_one() -> None:
    robot = load_robot("ur10")
    poses = forward(robot, random_joints(20, 3))
    poses[4, 0, 3] += 5000.0
    together = inverse_kinematics(robot, poses)
    for i in range(len(poses)):
        alone = inverse_kinematics(robot, poses[i : i + 1])
        np.testing.assert_array_equal(alone.state[0], together.state[i])
        np.testing.assert_allclose(alone.joints[0], together.joints[i], rtol=0.0, atol=1e-13)


def test_no_poses_at_all() -> None:
    found = inverse_kinematics(load_robot("ur5"), np.zeros((0, 4, 4)))
    assert found.joints.shape == (0, 8, 6)
    assert found.valid.shape == (0, 8)


@given(st.integers(0, 2**32 - 1), st.sampled_from(["mdh", "dh"]), st.booleans())
def test_every_arm_of_the_structure(seed: int, convention: Convention, against: bool) -> None:
    """Lengths, offsets and senses drawn at random: spherical wrists in both conventions."""
    rng = np.random.default_rng(seed)
    turn = -1.0 if against else 1.0
    a, d = rng.uniform(50.0, 400.0, 6), rng.uniform(50.0, 400.0, 6)
    theta = rng.uniform(-np.pi, np.pi, 6)
    base = load_robot("abb-irb120")
    if convention == "mdh":
        alpha = (0.0, -RIGHT, 0.0, turn * RIGHT, RIGHT, -RIGHT)
        lengths = (0.0, a[1], a[2], a[3], 0.0, 0.0), (d[0], d[1], -d[2], d[3], 0.0, d[5])
    else:
        alpha = (turn * RIGHT, 0.0, RIGHT, -RIGHT, RIGHT, 0.0)
        lengths = (a[0], a[1], a[2], 0.0, 0.0, 0.0), (d[0], d[1], d[2], d[3], 0.0, d[5])
    robot = replace(
        base,
        convention=convention,
        base="plain",
        alpha=alpha,
        a=lengths[0],
        d=lengths[1],
        theta=tuple(theta),
    )
    joints = rng.uniform(-np.pi, np.pi, (20, 6))
    poses = forward(robot, joints)
    found = inverse_kinematics(robot, poses)
    assert structure_of(ZeroPose.of(robot)).kind == "spherical wrist"
    assert np.max(np.nanmin(apart(found.joints, joints[:, None]), axis=1)) < 1e-6
    again = forward(robot, found.joints[found.valid])
    np.testing.assert_allclose(again, poses[np.nonzero(found.valid)[0]], atol=1e-9)


def test_turns_within_limits() -> None:
    lower, upper = np.radians([-400.0, -170.0]), np.radians([400.0, 170.0])
    near = nearest_turns(np.radians([30.0, 100.0]), np.radians([-300.0, -200.0]), lower, upper)
    np.testing.assert_allclose(np.degrees(near), [-330.0, 100.0], atol=1e-9)
    far = nearest_turns(np.radians([30.0, 100.0]), np.radians([9000.0, 0.0]), lower, upper)
    np.testing.assert_allclose(np.degrees(far), [390.0, 100.0], atol=1e-9)
    beyond = np.radians([0.0, 175.0])
    np.testing.assert_array_equal(nearest_turns(beyond, np.zeros(2), lower, upper), [0.0, np.nan])
    assert np.all(np.isnan(within_limits(beyond, np.zeros(2), lower, upper)))


def test_nearest_to_a_seed_within_limits() -> None:
    robot: Robot = load_robot("abb-irb120")
    lower, upper = np.array(robot.lower), np.array(robot.upper)
    rng = np.random.default_rng(5)
    joints = rng.uniform(lower, upper, (300, 6))
    found = inverse_kinematics(robot, forward(robot, joints))
    seed = joints + rng.uniform(-0.002, 0.002, joints.shape)
    turned = within_limits(found.joints, seed[:, None], lower, upper)
    branch = nearest_branch(turned, seed)
    np.testing.assert_allclose(turned[np.arange(300), branch], joints, atol=1e-7)
    assert [BRANCHES[k] for k in branch] == branches(robot, joints)
    nowhere = within_limits(found.joints, seed[:, None], lower - 100.0, lower - 99.0)
    assert np.all(nearest_branch(nowhere, seed) == -1)


@pytest.mark.parametrize(
    ("change", "what"),
    [
        ({"alpha": (0.0, -RIGHT, 0.01, -RIGHT, RIGHT, -RIGHT)}, "axes 2 and 3 are not parallel"),
        ({"alpha": (0.0, -RIGHT, 0.0, -RIGHT, 1.0, -RIGHT)}, r"axes 4 and 5 are at 57\.296 deg"),
        ({"alpha": (0.0, -1.0, 0.0, -RIGHT, RIGHT, -RIGHT)}, "axes 1 and 2"),
        ({"a": (0.0, 0.0, 0.0, 70.0, 0.0, 0.0)}, "coincide"),
    ],
)
def test_other_structures_are_refused_by_what_is_in_the_way(change: dict[str, object], what: str) -> None:
    robot = replace(load_robot("abb-irb120"), **change)  # type: ignore[arg-type]
    with pytest.raises(DataError, match=what) as refused:
        inverse_kinematics(robot, np.eye(4)[None])
    assert "abb-irb120" in str(refused.value)


def test_seven_joints_without_a_shoulder_are_refused() -> None:
    six = load_robot("ur5")
    names = ("alpha", "a", "theta", "d", "lower", "upper")
    seven = replace(six, **{name: (*getattr(six, name), 1.0) for name in names})
    with pytest.raises(DataError, match="axes 2 and 3 are not square"):
        arm_of(seven)


@pytest.mark.parametrize(
    ("poses", "seed", "what"),
    [
        (np.eye(4), None, "shape"),
        (np.full((1, 4, 4), np.nan), None, "finite"),
        (np.eye(4)[None], np.zeros((2, 6)), "seed"),
    ],
)
def test_wrong_arguments_are_named(poses: Array, seed: Array | None, what: str) -> None:
    with pytest.raises(ValueError, match=what):
        inverse_kinematics(load_robot("ur5"), poses, seed=seed)
