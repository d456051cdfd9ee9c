"""Test odd recordings of a moving robot.

These would catch: a frozen point that spoils the start, files with another meaning that are refused without a name,
and samples missing one by one without a count. They would also catch rounded times taken for a jump, a joint that
wraps, and a sample written twice that stops everything.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib import DataError, load_robot
from calib.motion import JointStream, PointStream, align, read_joints, read_points
from calib.motion.arm import AlignedArm
from calib.motion.solve import Solve
from tests.calib.machines import machine
from tests.calib.moving import TOOL, Moving, simulate, write_robot, write_tracker

ROBOT = load_robot("ur5")


@pytest.fixture(scope="module")
def moving() -> Moving:
    return simulate(3, legs=16, duration=160.0, robot_hz=50.0)


def tracker(moving: Moving) -> PointStream:
    return PointStream(moving.tracker_time, moving.points)


def test_a_point_that_freezes_for_20_s_is_left_out(moving: Moving) -> None:
    since = moving.tracker_time - moving.tracker_time[0]
    frozen = (since > 60.0) & (since < 80.0)
    points = np.where(frozen[:, None], moving.points[np.argmax(frozen)], moving.points)
    found = align(
        ROBOT,
        JointStream(moving.robot_time, moving.joints),
        PointStream(moving.tracker_time, points),
        TOOL,
    )
    assert abs(found.clocks.offset - moving.offset) < 0.1e-3
    assert np.mean(found.weight[frozen] == 0.0) > 0.8
    assert np.mean(found.weight[~frozen] > 0.0) > 0.98


def test_stretches_without_a_move_say_nothing_of_the_clocks() -> None:
    """Intervals without a move give no information about the clocks.

    The robot rests most of the time. Its joints tremble in their last digit, which is no motion.
    """
    moving = simulate(6, legs=9, duration=240.0, rest=25.0, robot_hz=50.0)
    tremble = np.random.default_rng(1).integers(-1, 2, moving.joints.shape) * 1e-9
    joints = JointStream(moving.robot_time, moving.joints + tremble)
    found = align(ROBOT, joints, tracker(moving), TOOL)
    assert np.isinf(found.clocks.step_at)
    assert abs(found.clocks.offset - moving.offset) < 4.0 * found.u_offset < 1e-3
    arm = AlignedArm(ROBOT, np.eye(4), np.array(TOOL), tool_known=False)
    solve = Solve(arm, joints, moving.points, moving.tracker_time)
    begins, _ = solve.offsets(found.clocks, np.zeros(len(arm.terms)))
    assert 5 < len(begins) < 30  # of sixty


@pytest.mark.parametrize(
    ("joints", "points", "message"),
    [
        (np.eye(6), np.diag([1.0, -1.0, 1.0]), "left-handed"),
        (np.eye(6), np.eye(3) / 25.4, "are inches, not millimetres"),
        (np.diag([1.0, 1.0, 1.0, 1.0, -1.0, 1.0]), np.eye(3), "joint 5 turns in the other direction"),
        (np.diag([1.0, 1.0, 1.0, np.pi / 180.0, 1.0, 1.0]), np.eye(3), "joint 4 is given in radians"),
        # the fit alone turns its tool round and takes it
        (np.diag([1.0, 1.0, 1.0, 1.0, 1.0, -1.0]), np.eye(3), "joint 6 turns in the other direction"),
        (np.eye(6)[[0, 2, 1, 3, 4, 5]], np.eye(3), "joints 2 and 3 are in each other's column"),
    ],
)
def test_streams_that_mean_something_else_are_refused_by_that(
    moving: Moving, joints: np.ndarray, points: np.ndarray, message: str
) -> None:
    with pytest.raises(DataError, match=message):
        align(
            ROBOT,
            JointStream(moving.robot_time, moving.joints @ joints),
            PointStream(moving.tracker_time, moving.points @ points),
            TOOL,
        )


def test_samples_that_are_missing_one_by_one_are_counted(moving: Moving) -> None:
    count = len(moving.robot_time)
    rng = np.random.default_rng(1)
    kept = np.sort(rng.permutation(count - 2)[: count - 500] + 1)
    stream = JointStream(moving.robot_time[kept], moving.joints[kept])
    assert stream.lost == kept[-1] - kept[0] + 1 - len(kept)
    late = moving.robot_time + rng.uniform(0.0, 0.4, count) / 50.0
    assert JointStream(late, moving.joints).lost == 0


def test_rounded_times_are_no_jump(moving: Moving) -> None:
    """A rate of 60 ppm steps over one rounding of 10 ms in this recording."""
    joints = JointStream(moving.robot_time, moving.joints)
    plain = align(ROBOT, joints, tracker(moving), TOOL)
    time = moving.tracker_time - moving.tracker_time[0]
    rounded = np.round(time * (1.0 + 60e-6 - moving.rate), 2)
    found = align(ROBOT, joints, PointStream(rounded, moving.points), TOOL)
    assert np.isinf(found.clocks.step_at)
    assert any("are rounded to 10 ms: a jump of a clock below 15 ms" in text for text in found.warnings)
    truth = moving.offset + 0.5 * (moving.tracker_time[0] + moving.tracker_time[-1]) - 0.5 * rounded[-1]
    assert abs(found.clocks.offset - truth) < 3.0 * found.u_offset
    assert found.u_offset > 10.0 * plain.u_offset
    assert tracker(moving).resolution == 0.0


def test_even_times_are_not_rounded_ones(moving: Moving) -> None:
    kept = np.delete(np.arange(len(moving.robot_time)), [40, 41, 900])
    assert JointStream(moving.robot_time[kept], moving.joints[kept]).resolution == 0.0


def test_a_joint_that_wraps_is_followed(moving: Moving, tmp_path: Path) -> None:
    turned = moving.joints + np.array([0.0, 0.0, 0.0, 0.0, 0.0, 3.0])
    wrapped = (turned + np.pi) % (2.0 * np.pi) - np.pi
    read = read_joints(write_robot(tmp_path / "robot.csv", replace(moving, joints=wrapped)), ROBOT)
    np.testing.assert_allclose(np.diff(read.joints, axis=0), np.diff(turned, axis=0), atol=1e-7)
    assert read.remarks == ("Column 'j6_deg' wraps at half a turn; the joint was followed across.",)


def test_samples_written_twice_count_once(moving: Moving, tmp_path: Path) -> None:
    for write, read in (
        (write_robot, lambda path: read_joints(path, ROBOT)),
        (write_tracker, read_points),
    ):
        path = write(tmp_path / "stream.csv", moving)
        plain, lines = read(path), path.read_text("utf-8").splitlines()
        path.write_text("\n".join([*lines[:30], *lines[28:40], lines[39], *lines[40:]]), encoding="utf-8")
        # rows 28 and 29 come again after each other: that is time going back
        with pytest.raises(DataError, match=r"comes after .*; times must increase"):
            read(path)
        path.write_text("\n".join([*lines[:40], lines[39], *lines[40:]]), encoding="utf-8")
        again = read(path)
        np.testing.assert_array_equal(again.time, plain.time)
        assert again.remarks == ("1 samples were written twice; each counts once.",)
        other = lines[39][:-3] + "111"
        path.write_text("\n".join([*lines[:40], other, *lines[40:]]), encoding="utf-8")
        with pytest.raises(DataError, match="given twice, with other values") as refused:
            read(path)
        assert refused.value.line == 41


def test_an_axis_that_the_robot_lacks_is_refused_where_it_moved(moving: Moving, tmp_path: Path) -> None:
    path = write_robot(tmp_path / "robot.csv", moving)
    head, *rows = path.read_text("utf-8").splitlines()
    for name, step, refused in (("e1_mm", 0.1, True), ("e1_mm", 0.0, False), ("j7_deg", 0.0, True)):
        more = [f"{row},{step * i:.1f}" for i, row in enumerate(rows)]
        path.write_text("\n".join([f"{head},{name}", *more]) + "\n", "utf-8")
        if refused:
            with pytest.raises(DataError, match=f"'{name}' is there, but the robot"):
                read_joints(path, ROBOT)
        else:
            read_joints(path, ROBOT)


def test_a_joint_that_follows_others_needs_no_column(tmp_path: Path) -> None:
    robot = machine("palletizer", tmp_path)
    counted = np.column_stack([np.linspace(-60.0, 60.0 - 9.0 * k, 30) for k in range(5)])
    counted[:, 3] = 0.0
    path = tmp_path / "robot.csv"
    rows = np.column_stack([0.1 * np.arange(30), counted[:, [0, 1, 2, 4]]])
    np.savetxt(path, rows, delimiter=",", header="t_s,j1_deg,j2_deg,j3_deg,j5_deg", comments="")
    read = read_joints(path, robot, "rods")
    np.testing.assert_allclose(read.joints, robot.model_angles(np.radians(counted), "rods"), atol=1e-9)
    named = read_joints(
        path, robot, "rods", "time=t_s[s]," + ",".join(f"j{k}=j{k}_deg[deg]" for k in (1, 2, 3, 5))
    )
    np.testing.assert_array_equal(named.joints, read.joints)
    with pytest.raises(DataError, match="j4"):
        read_joints(path, robot)
