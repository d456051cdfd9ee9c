"""Programs of every dialect. These would catch: a tool, a frame, a unit or a turn applied the wrong way, a target
that is corrected though nobody knows where it is, text that changes beside the numbers, and figures that are not
those of the written file. What the robot does with a corrected file is computed here a second time, by hand.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import forward
from calib.array import Array
from calib.compensate.inverse import nominal_inverse
from calib.errors import DataError
from calib.model.stated import StatedConditions
from calib.saved.model_file import SavedModel
from service.programs import Compensation, KnownFrames, compensate, named_frames, read_program
from service.programs.compensation import CORRECTED, EMPTY, REFUSED
from tests.service.robot_programs import EXT, LS, PROGRAMS, RAPID, SCRIPT, TABLE, model_of, real_flange, write

STATED = StatedConditions(temperature_c=22.0)
UTOOL = "1=5,-10,120,10,20,30"
UFRAME = "2=50,20,-15,0,5,40"
KNOWN = KnownFrames(named_frames("--tool", [UTOOL]), named_frames("--frame", [UFRAME]))


def corrected(
    folder: Path,
    name: str,
    text: str,
    saved: SavedModel,
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


def lands(saved: SavedModel, flange: Array, seed: Sequence[float], tool: Array) -> Array:
    """Where the real tool lands when the controller is sent a flange pose: its own joints, then the real chain."""
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


def _lands_like(saved: SavedModel, flange: Array, home: Sequence[float], tool: Array) -> Array:
    """The controller goes to the solution nearest to `home`: a far start for Newton, so by small steps."""
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


def rapid(*body: str) -> str:
    return "MODULE M\n" + "\n".join(body) + "\nENDMODULE\n"


STRAIGHT = "467.731888905,0,481.579957463],[0.573576436351,0,0.819152044289,0]"  # joint 2 at 20 deg, others 0
POINT = f"[[380,0,400],[0.5,0,0.8660254,0],[0,0,0,0],{EXT}]"
USE = "PROC main()\nMoveL p1,v10,fine,tool0;\nENDPROC"
P1 = f"CONST robtarget p1:={POINT};"


@pytest.mark.parametrize(
    ("text", "line", "what"),
    [
        (rapid(P1.replace("0.866", "0.9"), USE), 2, "quaternion has norm 1.03"),
        (rapid(P1.replace("380", "3800"), USE), 2, "out of reach"),
        (
            rapid(P1.replace("[0,0,0,0]", "[1,0,0,0]"), USE),
            2,
            "joint 1 is at 0.00 deg, asked for is 89.5",
        ),
        (rapid(P1.replace("[0,0,0,0]", "[0,0,0,9]"), USE), 2, "configuration number is 9"),
        (rapid(P1.replace("9E9", "12.5", 1), USE), 2, "external axis"),
        (rapid(P1.replace("380", "100+280"), USE), 2, "not a plain value"),
        (rapid(P1.replace("380", "xPos"), USE), 2, "'xPos' has no value"),
        (rapid(P1), 2, "no motion of this module uses it"),
        (rapid(P1, USE.replace("tool0", "tGun")), 2, "'tgun' is not declared in this module: give --tool"),
        (rapid(P1, USE.replace("tool0", "tool0\\WObj:=wX")), 2, "give --frame wx="),
        (
            rapid(P1, USE.replace("ENDPROC", "p1.trans.x:=10;\nENDPROC")),
            2,
            r"while the program runs \(line 5\)",
        ),
        (rapid(P1, P1, USE), 2, "declared more than once"),
        (rapid("VAR robtarget p1;", USE), 2, "has no value"),
        (rapid(USE), 3, "'p1' .*is not declared"),
        (rapid(P1, "CONST robtarget p2:=p1;", USE, USE.replace("p1", "p2")), 3, "a copy of 'p1'"),
        (
            rapid(
                f"CONST robtarget a{{1}}:=[{POINT}];",
                "CONST robtarget b{1}:=a;",
                USE.replace("p1", "a{1}"),
                USE.replace("p1", "b{1}"),
            ),
            3,
            "a copy of 'a'",
        ),
        (rapid(USE.replace("p1", "CRobT(\\Tool:=tool0)")), 3, "computed while the program runs"),
        (
            rapid(
                P1,
                "PERS tooldata t:=[TRUE,[[0,0,9],[1,0,0,0]],[1,[0,0,1],[1,0,0,0],0,0,0]];",
                USE,
                USE.replace("tool0", "t"),
            ),
            2,
            "one correction cannot serve both",
        ),
        (
            rapid(f"CONST robtarget p1:=[[{STRAIGHT},[0,0,0,0],{EXT}];", USE),
            2,
            "wrist singular",
        ),
        (
            rapid(f"CONST jointtarget p1:=[[10,20,0,0,0.5,0],{EXT}];", USE.replace("MoveL", "MoveAbsJ")),
            2,
            "singular",
        ),
        (
            rapid(f"CONST jointtarget p1:=[[10,120,0,0,40,0],{EXT}];", USE.replace("MoveL", "MoveAbsJ")),
            2,
            "limit",
        ),
    ],
)
def test_rapid_targets_that_cannot_be_told_are_refused_with_line_and_reason(
    tmp_path: Path, text: str, line: int, what: str
) -> None:
    done = corrected(tmp_path, "a.mod", text, model_of("abb-irb120"))
    refused = done.of(REFUSED)
    assert any(o.target.line == line and re.search(what, f"'{o.target.name}' {o.why}") for o in refused), [
        (o.target.line, o.target.name, o.why) for o in refused
    ]


@pytest.mark.parametrize(
    ("old", "new", "what"),
    [
        ("UT : 1,\t\tCONFIG : 'N U T", "UT : 3,\t\tCONFIG : 'N U T", "UT 3 is not in the program"),
        ("UF : 2", "UF : 5", "give --frame 5="),
        ("N U T, 0, 0, 0',\n\tX =   300", "U T, 0, 0, 0',\n\tX =   300", "noflip from flip"),
        ("N U T, 0, 0, 0',\n\tX =   300", "N U T, 1, 0, 0',\n\tX =   300", "limit"),
        ("X =   300.000", "X =  3000.000", "out of reach"),
        ("100mm/sec FINE    ;\n   3", "100mm/sec FINE INC ;\n   3", r"used with INC \(line 10\)"),
        ("R =   -90.000 deg\n", "R =   -90.000 deg,\n\tE1 = 10.000 mm\n", "extended axis"),
        ("J5=   -45.500", "J5=      .000", "singular"),
        ("J1=    10.500", "J1=   190.500", "limit"),
    ],
)
def test_fanuc_positions_that_cannot_be_told_are_refused(
    tmp_path: Path, old: str, new: str, what: str
) -> None:
    assert old in LS
    done = corrected(tmp_path, "a.ls", LS.replace(old, new, 1), model_of("fanuc-lrmate200ic"))
    (refused,) = done.of(REFUSED)
    assert re.search(what, refused.why), refused.why


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("movel(p[-0.4,-0.2,0.3,0,3.14,0])\n", "no set_tcp"),
        ("set_tcp(p[0,0,0,0,0,0])\nmovel(p[-0.4,-0.2,0.3,0,3.14,0])\n", "no joint target before"),
        ("movej(q)\n", "'q' has no value"),
        ("q=[0,0,0,0,0,0]\nq=[1,0,0,0,0,0]\nmovej(q)\n", "computed while"),
        ("q=[0,-1,1,0,1,0]\nq[0]=1\nmovej(q)\n", "computed while"),
        ("movej(get_inverse_kin(p[1,1,1,0,0,0]))\n", "neither six"),
        ("movej([0,1,2,3])\n", "neither six"),
        ("movel(pose_trans(a, b))\n", "neither six"),
    ],
)
def test_urscript_waypoints_that_cannot_be_told_are_refused(tmp_path: Path, text: str, what: str) -> None:
    done = corrected(tmp_path, "a.script", text, model_of("ur5"), KnownFrames())
    (refused,) = done.of(REFUSED)
    assert re.search(what, f"'{refused.target.name}' {refused.why}"), refused.why


@pytest.mark.parametrize(
    ("robot", "name", "text", "what"),
    [
        ("abb-irb120", "a.mod", "hello world", "line 1: is not a RAPID module"),
        ("abb-irb120", "a.mod", rapid("CONST robtarget p1:=[[1,2"), "line 2: a statement is not ended"),
        ("abb-irb120", "a.mod", rapid('TPWrite "oops;'), "line 2: a string is not closed"),
        ("abb-irb120", "a.mod", rapid("PROC main()", "ENDPROC"), "holds no target"),
        ("abb-irb120", "a.ls", LS, "is a Fanuc program, and the model is of abb-irb120 by ABB"),
        ("ur5", "a.mod", RAPID, "is a RAPID module"),
        ("abb-irb120", "a.txt", RAPID, "must end in"),
        ("fanuc-lrmate200ic", "a.ls", "/PROG X\n/MN\n", "not a Fanuc program"),
        ("fanuc-lrmate200ic", "a.ls", LS.replace("};", "", 1), r"line \d+: "),
        ("fanuc-lrmate200ic", "a.ls", LS.replace("\tJ4=     0.000 deg,", "\t"), r"line 14: P\[1\] has no J4"),
        ("ur5", "a.script", "movej([1,2,3", "line 1: a bracket is not closed"),
        ("abb-irb120", "t.csv", TABLE.replace("target_id", "id"), "'target_id' is missing"),
        ("abb-irb120", "t.csv", TABLE.replace("j2_deg", "j2"), "'j2' has no unit"),
        ("abb-irb120", "t.csv", TABLE.replace("10,20", "10,nan"), "line 2: column 'j2_deg' is 'nan'"),
        ("abb-irb120", "t.csv", TABLE.replace("b,", "a,"), "line 3: target 'a' is there twice"),
        ("abb-irb120", "t.csv", "", "line 1: is empty"),
        ("abb-irb120", "t.csv", TABLE.replace(",x\n", "\n"), "line 3: has 15 cells, the header 16"),
    ],
)
def test_files_that_cannot_be_read_are_refused_with_their_line(
    tmp_path: Path, robot: str, name: str, text: str, what: str
) -> None:
    with pytest.raises(DataError, match=what):
        corrected(tmp_path, name, text, model_of(robot))


def test_table_rows_that_cannot_be_told_are_refused(tmp_path: Path) -> None:
    for old, new, what in (
        ("front/up/noflip", "left", "config 'left'"),
        ("0.7071068,0.7071068", "0.7071068,0.8", "norm"),
        ("380,50", "3800,50", "out of reach"),
    ):
        done = corrected(tmp_path, "t.csv", TABLE.replace(old, new), model_of("abb-irb120"))
        (refused,) = done.of(REFUSED)
        assert (refused.target.name, refused.target.line) == ("b", 3)
        assert what in refused.why


@pytest.mark.parametrize("text", ["1,2,3", "a=1,2,3,4,5,x", "=1,2,3,4,5,inf"])
def test_frames_that_are_none(text: str) -> None:
    with pytest.raises(DataError, match="--tool"):
        named_frames("--tool", [text])


def test_a_frame_given_twice() -> None:
    with pytest.raises(DataError, match="twice"):
        named_frames("--tool", [UTOOL, UTOOL])
