"""Programs, tables and frames that cannot be read or corrected: refused with their line and the reason."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from calib.errors import DataError
from service.programs import KnownFrames, named_frames
from service.programs.compensation import REFUSED
from tests.service.robot_programs import EXT, LS, RAPID, TABLE, model_of
from tests.service.test_programs import UTOOL, corrected


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
        ("R =   -90.000 deg\n", "R =   -90.000 deg,\n\tE1 = 10.000 mm\n", "external axis"),
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
        ("front/up/noflip", "left", "no branch 'left'"),
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
