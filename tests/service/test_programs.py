"""Programs of every dialect.

These would catch: a tool, a frame, a unit or a turn applied the wrong way, and a target that is corrected although its
position is unknown. They would also catch text that changes next to the numbers, and results that are not those of the
written file. The motion of the robot with a corrected file is calculated here a second time, independently.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib import CalibratedModel, StatedConditions, forward
from calib.arm.inverse_kinematics import nominal_inverse
from calib.array import Array
from service.programs import Compensation, KnownFrames, compensate, named_frames, read_program
from service.programs.compensation import CORRECTED, EMPTY, REFUSED
from tests.service.robot_programs import LS, PROGRAMS, RAPID, SCRIPT, TABLE, model_of, real_flange, write

STATED = StatedConditions(temperature_c=22.0)
UTOOL = "1=5,-10,120,10,20,30"
UFRAME = "2=50,20,-15,0,5,40"
KNOWN = KnownFrames(named_frames("--tool", [UTOOL]), named_frames("--frame", [UFRAME]))


def corrected(
    folder: Path,
    name: str,
    text: str,
    saved: CalibratedModel,
    known: KnownFrames = KNOWN,
    *,
    inverse: bool = False,
) -> Compensation:
    path = write(folder, name, text)
    program = read_program(path, saved.model.robot, known)
    return compensate(program, path, saved, STATED, known, inverse=inverse)


def frame(x: float, y: float, z: float, rotation: Rotation) -> Array:
    out = np.eye(4)
    out[:3, :3], out[:3, 3] = rotation.as_matrix(), (x, y, z)
    return out


def lands(saved: CalibratedModel, flange: Array, seed: Sequence[float], tool: Array) -> Array:
    """Calculate the pose of the real tool after the controller is sent a flange pose.

    The controller calculates nominal joint angles, and the real chain moves them.
    """
    near = saved.model.robot.model_angles(np.radians([seed]), saved.coupling)
    joints = nominal_inverse(saved.model.robot, flange[None], near, np.zeros(3))
    np.testing.assert_allclose(forward(saved.model.robot, joints)[0], flange, atol=1e-6)
    return real_flange(saved, joints[0]) @ tool


def numbers_after(text: str, marker: str, count: int) -> list[float]:
    """The first `count` numbers behind a marker."""
    found = re.findall(r"(?<!\w)[-+]?(?:\d+\.?\d*|\.\d+)(?:E\d+)?", text[text.index(marker) + len(marker) :])
    return [float(number) for number in found[:count]]


def rapid_pose(text: str, name: str) -> Array:
    x, y, z, w, i, j, k = numbers_after(text, f"{name}:=", 7)
    return frame(x, y, z, Rotation.from_quat([i, j, k, w]))


def test_a_robtarget_lands_where_it_says_with_its_tool_in_its_work_object(tmp_path: Path) -> None:
    saved = model_of("abb-irb120")
    done = corrected(tmp_path, "a.mod", RAPID, saved)
    assert [o.status for o in done.outcomes] == [CORRECTED] * 6
    table = frame(100.0, -50.0, 20.0, Rotation.from_euler("z", 5.0, degrees=True)) @ frame(
        0, 0, 5, Rotation.identity()
    )
    grip = frame(10.0, -20.0, 125.0, Rotation.from_euler("y", 45.0, degrees=True))
    wanted = table @ rapid_pose(RAPID, "p1")
    sent = table @ rapid_pose(done.text, "p1") @ np.linalg.inv(grip)
    landed = lands(saved, sent, [28.0, 24.0, 11.0, -41.0, 80.0, 130.0], grip)
    before = lands(saved, wanted @ np.linalg.inv(grip), [28.0, 24.0, 11.0, -41.0, 80.0, 130.0], grip)
    assert np.linalg.norm((before - wanted)[:3, 3]) > 0.1
    assert np.linalg.norm((landed - wanted)[:3, 3]) < 1e-4
    assert np.max(np.abs((landed - wanted)[:3, :3])) < 1e-6
    outcome = next(o for o in done.outcomes if o.target.name == "p1")
    shift = np.linalg.norm((rapid_pose(done.text, "p1") - rapid_pose(RAPID, "p1"))[:3, 3])
    assert outcome.moved[0] == pytest.approx(shift, abs=1e-4)
    assert outcome.quantised[0] < 2e-5


def test_a_jointtarget_lands_where_the_nominal_robot_would(tmp_path: Path) -> None:
    saved = model_of("abb-irb120")
    done = corrected(tmp_path, "a.mod", RAPID, saved)
    for marker in ("j1:=", "path{2}:=", "MoveAbsJ [["):
        old, new = (np.radians(numbers_after(text, marker, 6)) for text in (RAPID, done.text))
        assert np.max(np.abs(old - new)) > 1e-4
        wanted = forward(saved.model.robot, old[None])[0]
        np.testing.assert_allclose(real_flange(saved, new)[:3, 3], wanted[:3, 3], atol=1e-4)


def test_rapid_text_beside_the_numbers_of_targets_stays(tmp_path: Path) -> None:
    done = corrected(tmp_path, "a.mod", RAPID, model_of("abb-irb120"))
    old, new = RAPID.splitlines(), done.text.splitlines()
    changed = [a for a, b in zip(old, new, strict=True) if a != b]
    assert len(changed) == 8  # j1, p1, three lines of p2, two of path, one MoveAbsJ
    for text in ('say:="MoveL fake', "CONST num zSafe:=520;", "PERS tooldata", "wobjdata", "count:=count+1"):
        assert text in done.text
    assert "zSafe]" not in done.text  # a named height cannot hold a corrected one
    notes = {o.target.name: o.target.notes for o in done.outcomes}
    assert "Offs" in notes["p2"][0]
    assert notes["p1"] == ()


def test_quarter_turns_follow_the_joints(tmp_path: Path) -> None:
    """Joint 1 of p2 stands at 0 and leaves the first quarter, or not, with the correction."""
    saved = model_of("abb-irb120")
    done = corrected(tmp_path, "a.mod", RAPID, saved)
    rest = done.text[done.text.index("p2:=") :]
    cf1 = float(re.findall(r"\[(-?\d),(-?\d),(-?\d),0\]", rest)[0][0])
    x, y, *_ = numbers_after(done.text, "p2:=", 3)
    assert cf1 == (0.0 if y >= 0.0 else -1.0)
    assert x == pytest.approx(380.0, abs=5.0)


def test_fanuc_positions_land_where_they_say(tmp_path: Path) -> None:
    saved = model_of("fanuc-lrmate200ic")
    done = corrected(tmp_path, "a.ls", LS, saved)
    assert [(o.target.name, o.status) for o in done.outcomes] == [
        ("P[1]", CORRECTED),
        ("P[2:name]", CORRECTED),
        ("P[3]", EMPTY),
        ("P[4:bare]", CORRECTED),
    ]
    tool = frame(5.0, -10.0, 120.0, Rotation.from_euler("xyz", [10, 20, 30], degrees=True))
    user = frame(50.0, 20.0, -15.0, Rotation.from_euler("xyz", [0, 5, 40], degrees=True))
    world = frame(0.0, 0.0, 330.0, Rotation.identity())
    for name, where, seed in (
        ('P[2:"name"]', world @ user, [26.0, 2.0, -23.0, -16.0, -86.0, -45.0]),
        ("P[4:bare]", world, [16.0, 15.0, -16.0, -159.0, 98.0, -150.0]),
    ):
        poses = []
        for text in (LS, done.text):
            body = text[text.index(name) : text.index("}", text.index(name))]
            v = [float(re.findall(rf"\b{a}\s*=\s*(\S+)", body)[0]) for a in "XYZWPR"]
            poses.append(where @ frame(v[0], v[1], v[2], Rotation.from_euler("xyz", v[3:], degrees=True)))
        wanted, sent = poses
        landed = lands(saved, sent @ np.linalg.inv(tool), seed, tool)
        off = np.linalg.norm((landed - wanted)[:3, 3])
        assert off < 0.004  # 0.001 mm and 0.001 deg at 120 mm
        assert np.linalg.norm((sent - wanted)[:3, 3]) > 0.1


def test_fanuc_joints_count_as_the_controller_counts(tmp_path: Path) -> None:
    saved = model_of("fanuc-lrmate200ic")
    done = corrected(tmp_path, "a.ls", LS, saved)
    old, new = ([float(x) for x in re.findall(r"J\d=\s*(\S+) deg", text)] for text in (LS, done.text))
    assert new[6] == old[6] == 5.0  # group 2 is another machine
    model = [saved.model.robot.model_angles(np.radians([each[:6]]), "fanuc-j23")[0] for each in (old, new)]
    wanted = forward(saved.model.robot, model[0][None])[0]
    assert np.linalg.norm(real_flange(saved, model[1])[:3, 3] - wanted[:3, 3]) < 0.02  # 0.001 deg a joint
    outcome = done.outcomes[0]
    rounded = np.linalg.norm(real_flange(saved, model[1])[:3, 3] - wanted[:3, 3])
    assert outcome.quantised[0] == pytest.approx(rounded, abs=1e-3)


def test_fanuc_text_keeps_its_shape(tmp_path: Path) -> None:
    source = LS.replace("\n", "\r\n")
    done = corrected(tmp_path, "a.ls", source, model_of("fanuc-lrmate200ic"))
    assert done.text.count("\r\n") == source.count("\r\n")
    assert "\n" not in done.text.replace("\r\n", "")
    number = re.compile(r"-?\d*\.\d+")
    assert number.sub("#", done.text).replace(" ", "") == number.sub("#", source).replace(" ", "")
    assert len(done.text.split("\r\n")[21]) == len(source.split("\r\n")[21])  # fields keep their width
    assert done.text.count("********") == 6


def test_urscript_waypoints_land_where_they_say(tmp_path: Path) -> None:
    saved = model_of("ur5")
    done = corrected(tmp_path, "a.script", SCRIPT, saved)
    assert [o.status for o in done.outcomes] == [CORRECTED] * 5
    tool = frame(10.0, 0.0, 100.0, Rotation.from_rotvec([0.0, 0.2, 0.0]))
    home = [0.1, -1.57, 1.2, np.radians(-40.0), -1.2, 0.0]
    for marker in ("p2=p[", "movec(p["):
        poses = []
        for text in (SCRIPT, done.text):
            v = numbers_after(text, marker, 6)
            x, y, z = (1000.0 * metres for metres in v[:3])
            poses.append(frame(x, y, z, Rotation.from_rotvec(v[3:])))
        wanted, sent = poses
        known = next(o for o in done.outcomes if o.target.flange is not None)
        assert known.moved[0] > 0.1
        landed = _lands_like(saved, sent @ np.linalg.inv(tool), home, tool)
        assert np.linalg.norm((landed - wanted)[:3, 3]) < 1e-3
    joints = np.array(numbers_after(done.text, "home = [", 6))
    wanted = forward(saved.model.robot, np.array([home]))[0]
    np.testing.assert_allclose(real_flange(saved, joints)[:3, 3], wanted[:3, 3], atol=1e-3)
    assert "d2r(-40)" not in done.text
    assert "# [1,2,3,4,5,6]" in done.text
    assert 'textmsg("movej([0,0,0,0,0,0])")' in done.text


def _lands_like(saved: CalibratedModel, flange: Array, home: Sequence[float], tool: Array) -> Array:
    """Calculate the pose of the tool for the controller's solution nearest to `home`.

    `home` is a far start for Newton's method, so the flange approaches in small steps.
    """
    robot = saved.model.robot
    joints = np.array([home])
    begin = forward(robot, joints)[0]
    turn = Rotation.from_matrix(flange[:3, :3] @ begin[:3, :3].T).as_rotvec()
    for share in np.linspace(0.05, 1.0, 20):
        step = begin.copy()
        step[:3, 3] += share * (flange - begin)[:3, 3]
        step[:3, :3] = Rotation.from_rotvec(share * turn).as_matrix() @ begin[:3, :3]
        joints = nominal_inverse(robot, step[None], joints, np.zeros(3))
    return real_flange(saved, joints[0]) @ tool


def test_a_table_of_targets(tmp_path: Path) -> None:
    saved = model_of("abb-irb120")
    done = corrected(tmp_path, "t.csv", TABLE, saved)
    rows = [line.split(",") for line in done.text.splitlines()]
    joints = np.radians([float(cell) for cell in rows[1][1:7]])
    wanted = forward(saved.model.robot, np.radians([[10.0, 20.0, -30.0, 40.0, 50.0, 60.0]]))[0]
    np.testing.assert_allclose(real_flange(saved, joints)[:3, 3], wanted[:3, 3], atol=1e-6)
    x, y, z, w, i, j, k = (float(cell) for cell in rows[2][7:14])
    sent = frame(x, y, z, Rotation.from_quat([i, j, k, w]))
    landed = lands(saved, sent, [8.0, 20.0, 10.0, -5.0, 60.0, 5.0], np.eye(4))
    np.testing.assert_allclose(landed[:3, 3], [380.0, 50.0, 400.0], atol=1e-6)
    assert '"hello, you"' in done.text


def test_the_inverse_direction_undoes_the_correction(tmp_path: Path) -> None:
    for name, programs in PROGRAMS.items():
        for file, text in programs:
            saved = model_of(name)
            there = corrected(tmp_path, file, text, saved)
            back = corrected(tmp_path, file, there.text, saved, inverse=True)
            again = corrected(tmp_path, file, back.text, saved)
            number = re.compile(r"(?<![\w.])-?\d*\.\d+")
            old = [float(n) for n in number.findall(there.text)]
            new = [float(n) for n in number.findall(again.text)]
            scale = 0.005 if file.endswith(".ls") else 1e-4
            np.testing.assert_allclose(new, old, atol=scale, rtol=0.0)


def test_a_perfect_robot_changes_no_byte(tmp_path: Path) -> None:
    for name, programs in PROGRAMS.items():
        for file, text in programs:
            done = corrected(tmp_path, file, text, model_of(name, scale=0.0))
            assert done.text == text
            assert REFUSED not in [o.status for o in done.outcomes]
