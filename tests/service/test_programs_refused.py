"""Refusals of unreadable programs, tables and frames, and of targets without a correction.

They state the line and the reason.
"""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from calib.errors import DataError
from service.programs import KnownFrames, compensate, named_frames, read_program
from service.programs.compensation import REFUSED, Compensation
from tests.service.maker_programs import DAT, DTX, JBI, OPTIONS, PULSES, SRC, a_model
from tests.service.robot_programs import EXT, LS, RAPID, SCRIPT, TABLE, model_of, write
from tests.service.test_programs import STATED, UTOOL, corrected


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
        ("abb-irb120", "t.csv", TABLE.replace(",", ";"), "line 1: is separated by semicolons"),
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
        ("b,,,,,,,380", "b,1,2,3,4,5,6,380", "has joints and a pose"),
    ):
        done = corrected(tmp_path, "t.csv", TABLE.replace(old, new), model_of("abb-irb120"))
        (refused,) = done.of(REFUSED)
        assert (refused.target.name, refused.target.line) == ("b", 3)
        assert what in refused.why


IN_MAIN = "PROC main()\n"
MOVED = "   2:L P[2] 100mm/sec FINE    ;"
OTHERWISE = {
    "RAPID, a motion of a process": (
        RAPID,
        IN_MAIN,
        "SpotL [[1,2],[3]],v10,g,s,tool0;\n",
        "'SpotL' is not read",
        1,
    ),
    "RAPID, displaced": (RAPID, IN_MAIN, "PDispSet d;\n", "'PDispSet' in line .* displaces", 2),
    "RAPID, corrected path": (RAPID, IN_MAIN, "CorrWrite c,p;\n", "'CorrWrite' in line .* displaces", 2),
    "Fanuc, tool in the room": (LS, MOVED, MOVED.replace("FINE", "FINE RTCP"), "'RTCP' .line 10", 1),
    "Fanuc, offset": (
        LS,
        MOVED,
        MOVED.replace("FINE", "FINE Offset,PR[3]"),
        "'Offset' .line 10",
        1,
    ),
    "Fanuc, tool offset": (LS, MOVED, MOVED.replace("FINE", "FINE Tool_Offset,PR[3]"), "Tool_Offset", 1),
    "Fanuc, positioner": (LS, MOVED, MOVED.replace("FINE", "FINE COORD"), "'COORD' .line 10", 1),
    "Fanuc, register": (LS, MOVED, MOVED.replace("P[2]", "PR[2]"), "'L PR\\[2\\]' is not read", 1),
    "Fanuc, new frame": (LS, MOVED, "   2:  UFRAME[2]=PR[7] ;\n" + MOVED, "'UFRAME.* displaces", 2),
    "Fanuc, positioner beside a pose": (
        LS,
        "R =   -90.000 deg\n};",
        "R =   -90.000 deg\n   GP2:\n\tUF : 0, UT : 1,\n\tJ1=     5.000 deg\n};",
        "external axis",
        1,
    ),
    "URScript, servoj": (
        SCRIPT,
        "  movel(p2",
        "  servoj(home)\n  movel(p2",
        "'servoj' is not read|'servoj' .line 7. is not followed",
        4,
    ),
    "URScript, servoc": (
        SCRIPT,
        "  movel(p2",
        "  servoc(p2)\n  movel(p2",
        "'servoc' is not read|also used in line 7",
        2,
    ),
    "URScript, a copy": (SCRIPT, "  movel(p2", "  p3=p2\n  movel(p2", "also used in line 7", 1),
    "URScript, in a function": (SCRIPT, "  movel(p2", "  weld_at(p2)\n  movel(p2", "also used in line 7", 1),
    "URScript, another place by it": (
        SCRIPT,
        "  movel(p2",
        "  movel(pose_trans(p2, p[0,0,0.1,0,0,0]))\n  movel(p2",
        "also used in line 7|neither six",
        2,
    ),
    "URScript, unknown motion": (
        SCRIPT,
        "  movel(p2",
        "  move_until_contact(v)\n  movel(p2",
        "'move_until_contact' is not read",
        1,
    ),
    "URScript, conveyor": (
        SCRIPT,
        "  movel(p2",
        "  track_conveyor_linear(v, 500)\n  movel(p2",
        "'track_conveyor_linear' in line 7 displaces",
        3,
    ),
    "Fanuc, one that a register names": (
        LS,
        MOVED,
        "   2:L P[R[1]] 100mm/sec FINE Offset,PR[3] ;\n" + MOVED,
        "a register may name it",
        3,
    ),
    "Fanuc, given a place": (LS, MOVED, "   2:  P[2]=PR[1] ;\n" + MOVED, "also used in line 10", 1),
    "Fanuc, given a component": (LS, MOVED, "   2:  P[2,3]=R[1] ;\n" + MOVED, "also used in line 10", 1),
    "Fanuc, new frame by a register": (
        LS,
        MOVED,
        "   2:  UFRAME[R[1]]=PR[7] ;\n" + MOVED,
        "'UFRAME.* displaces",
        2,
    ),
    "Fanuc, seam tracking": (LS, MOVED, "   2:  Track TAST[1] ;\n" + MOVED, "'Track' .*displaces", 2),
    "Fanuc, touch": (LS, MOVED, "   2:  Touch Offset PR[1] ;\n" + MOVED, "'Touch Offset' .*displaces", 2),
    "Fanuc, circle to a register": (
        LS,
        MOVED,
        "   2:C P[2] \n    :  PR[4] 100mm/sec FINE    ;",
        "'C P.2. : PR.4.' is not read|'PR' .line 10",
        2,
    ),
    "Fanuc, offset behind a weld": (
        LS,
        MOVED,
        MOVED.replace("FINE", "FINE Arc Start Offset,PR[3]"),
        "'Offset' .line 10",
        1,
    ),
    "Fanuc, offset behind a timed call": (
        LS,
        MOVED,
        MOVED.replace("FINE", "FINE TB .10sec,CALL OPEN Offset,PR[3]"),
        "'Offset' .line 10",
        1,
    ),
    "Fanuc, unknown word": (LS, MOVED, MOVED.replace("FINE", "FINE FooBar[2]"), "'FooBar' .line 10", 1),
    "KUKA, geometric operator": (
        DAT,
        "ENDDAT",
        "LIN XP1:XP2\nENDDAT",
        "also used in line|'LIN XP1:XP2' is not read",
        3,
    ),
    "KUKA, component": (DAT, "ENDDAT", "XP1.X=5\nENDDAT", "also used in line", 1),
    "KUKA, given a place": (DAT, "ENDDAT", "XP1=$POS_ACT\nENDDAT", "also used in line", 1),
    "KUKA, tool of one motion": (
        DAT,
        "ENDDAT",
        "SLIN XP1 WITH $TOOL=TOOL_DATA[2]\nENDDAT",
        "also used in line|'SLIN XP1 WITH .* is not read",
        2,
    ),
    "KUKA, point of another file": (SRC, "PTP {", "PTP XUNK\nPTP {", "is not in this file", 1),
    "KUKA, correction by a sensor": (SRC, "PTP {", "IRET=RSI_MOVECORR()\nPTP {", "displaces", 2),
    "KUKA, base by component": (SRC, "PTP {", "BASE_DATA[1].X=3\nPTP {", "displaces", 2),
    "KUKA, place of the robot": (SRC, "PTP {", "$ROBROOT={X 1}\nPTP {", "displaces", 2),
    "KUKA, touch": (SRC, "PTP {", "TM_CORR(3)\nPTP {", "displaces", 2),
    "RAPID, a copy": (
        RAPID,
        IN_MAIN,
        "p9:=p2;\n",
        "an assignment",
        1,
    ),
    "RAPID, glue in place": (RAPID, IN_MAIN, f"GlueL {POINT},v10,g,z1,tool0;\n", "'GlueL' is not read", 1),
    "RAPID, unknown motion in place": (
        RAPID,
        IN_MAIN,
        f"GoThere {POINT},tool0;\n",
        "'GoThere' is not read",
        1,
    ),
    "RAPID, unknown motion elsewhere": (
        RAPID,
        IN_MAIN,
        "FollowIt pOther,v100,fine,tool0;\n",
        "'FollowIt' is not read",
        1,
    ),
    "KUKA, tool in the room": (SRC, "PTP {", "$IPO_MODE=#TCP\nPTP {", "displaces", 2),
    "KUKA, sensor": (SRC, "PTP {", "RSI_MOVECORR()\nPTP {", "displaces", 2),
    "Yaskawa, variable": (JBI, "MOVJ C00000", "MOVL P001 V=10\nMOVJ C00000", "'MOVL P001' is not read", 1),
}


def corrected_as_written(tmp_path: Path, text: str) -> Compensation:
    """Correct a text with the reader and the model of its dialect."""
    name, robot = {
        RAPID[:10]: ("a.mod", "abb-irb120"), LS[:10]: ("a.ls", "fanuc-lrmate200ic"), SCRIPT[:10]: ("a.script", "ur5"),
    }.get(text[:10], ("a.src" if text[:10] == SRC[:10] else "a.jbi", ""))  # fmt: skip
    if robot:
        return corrected(tmp_path, name, text, model_of(robot))
    known = KnownFrames(
        named_frames("--tool", [OPTIONS["tool"]]), named_frames("--frame", [OPTIONS["frame"]]), PULSES
    )
    return corrected(tmp_path, name, text, a_model("KUKA" if name == "a.src" else "Yaskawa"), known)


@pytest.mark.parametrize("case", OTHERWISE)
def test_what_drives_otherwise_than_it_is_written_is_refused_by_line(case: str, tmp_path: Path) -> None:
    text, old, new, what, count = OTHERWISE[case]
    assert old in text
    before = corrected_as_written(tmp_path, text)
    changed = text.replace(
        old, new if new.endswith(old) or new.startswith(("  ", "$", "RSI", "MOVL", "R ")) else old + new, 1
    )
    after = corrected_as_written(tmp_path, changed)
    assert before.of(REFUSED) == []
    refused = after.of(REFUSED)
    assert len(refused) == count, [(o.target.name, o.why) for o in refused]
    assert all(re.search(what, o.why) for o in refused), refused[0].why


# Text, what is replaced in it, by what, and the reasons of the targets that are refused then.
FIRST = "   1:J P[1] 10% FINE    ;"
WAY = ["depends on the way that the program takes"]
BESIDE_MOTIONS = {
    "Fanuc, the first instruction": (
        LS,
        FIRST,
        "   1:J P[1] 10% FINE Offset,PR[1]    ;",
        ["'Offset' .line 9"],
    ),
    "Fanuc, a copy": (LS, MOVED, "   2:  PR[1]=P[2] ;\n" + MOVED, ["also used in line 10"]),
    "Fanuc, a routine": (LS, MOVED, "   2:  CALL WELD(P[2]) ;\n" + MOVED, ["also used in line 10"]),
    "Fanuc, a copy by a register": (
        LS,
        MOVED,
        "   2:  PR[1]=P[R[2]] ;\n" + MOVED,
        ["a register may name it"] * 3,
    ),
    "Fanuc, pallet": (
        LS,
        MOVED,
        "   2:L PAL_1[BTM] 100mm/sec FINE ;\n" + MOVED,
        ["'L PAL_1.BTM.' is not read"],
    ),
    "Fanuc, two groups at once": (
        LS,
        MOVED,
        "   2:  GP1 L P[2] 100mm/sec FINE RTCP ;",
        ["also used in line 10"],
    ),
    "Fanuc, tool behind a condition": (
        LS,
        MOVED,
        "   2:  IF (R[1]=1),UTOOL[1]=PR[2] ;\n" + MOVED,
        ["displaces"] * 2,
    ),
    "Fanuc, conveyor": (
        LS,
        "/APPL\n",
        "/APPL\n  LINE_TRACK;\n    LINE_TRACK_SCHEDULE_NUMBER : 1;\n",
        ["LINE_TRACK_SCHEDULE_NUMBER : 1' in line 8 displaces"] * 2,
    ),
    "Fanuc, on the way of a motion": (
        LS,
        FIRST,
        "   1:J P[1] 10% FINE TB .50sec,CALL WELD(P[2])    ;",
        ["also used in line 9"],
    ),
    "Fanuc, twice": (LS, "P[4:bare]", "P[2]", ["more than once"] * 2),
    "Yaskawa, twice": (JBI, "C00001=", "C00000=", ["more than once"] * 2),
    "RAPID, behind a condition": (RAPID, IN_MAIN, IN_MAIN + "IF b WeldAt p2;\n", ["'WeldAt' .line 19"]),
    "RAPID, displaced behind a condition": (
        RAPID,
        IN_MAIN,
        IN_MAIN + "IF DInput(di1)=1 AND NOT b PDispSet d;\n",
        ["'PDispSet' in line 19 displaces"] * 2,
    ),
    "RAPID, spot behind a condition": (
        RAPID,
        IN_MAIN,
        IN_MAIN + "IF n>3 SpotL pOther,v10,g,s,tGun;\n",
        ["'SpotL' is not read"],
    ),
    "RAPID, undone": (RAPID, IN_MAIN, IN_MAIN + "UNDO\nPDispSet d;\n", ["displaces"] * 2),
    "RAPID, errors by number": (RAPID, IN_MAIN, IN_MAIN + "ERROR (3,4)\nPDispSet d;\n", ["displaces"] * 2),
    "RAPID, a routine by name": (RAPID, IN_MAIN, IN_MAIN + '%"weld"% p2;\n', ["used by '%' .line 19"]),
    "RAPID, a function": (RAPID, IN_MAIN, IN_MAIN + "IF drive(p2) THEN\nENDIF\n", ["used by 'IF' .line 19"]),
    "RAPID, path by a sensor": (
        RAPID,
        "tGrip\\WObj",
        "tGrip\\Corr\\WObj",
        ["'.Corr' in line .* displaces"] * 2,
    ),
    "RAPID, another tool": (
        RAPID,
        IN_MAIN,
        IN_MAIN + "SetIt tGrip;\n",
        ["'tgrip' may get another value in line 19"],
    ),
    "Yaskawa, shifted": (
        JBI,
        "MOVJ C00000",
        "SFTON P001 UF#(1)\nMOVJ C00000",
        ["'SFTON' in line .* displaces"] * 2,
    ),
    "Yaskawa, on a conveyor": (JBI, "MOVL C00001", "SYMOVL C00001", ["also used in line 19"]),
    "Yaskawa, local variable": (
        JBI,
        "MOVJ C00000",
        "MOVJ LP001 VJ=1\nMOVJ C00000",
        ["'MOVJ LP001' is not read"],
    ),
    "URScript, tool in a branch": (
        SCRIPT,
        "  movel(p2",
        "  if b:\n    set_tcp(p[0,0,0.2,0,0,0])\n  end\n  movel(p2",
        WAY * 3,
    ),
    "URScript, tool in a loop": (
        SCRIPT,
        "  movec(",
        "  while b:\n    movel(p[-0.4,-0.2,0.3,0,3.14,0.1])\n    set_tcp(p[0,0,0.2,0,0,0])\n  end\n  movec(",
        WAY * 3,
    ),
    "URScript, tool in a routine": (
        SCRIPT + "def sub():\n  set_tcp(p[0,0,0.2,0,0,0])\nend\n",
        "  movel(p2",
        "  sub()\n  movel(p2",
        WAY * 3,
    ),
    "URScript, posture that is computed": (
        SCRIPT,
        "  movel(p2",
        "  movej(there())\n  movel(p2",
        ["neither six", *["'movej' .line 7. is not followed"] * 3],
    ),
    "KUKA, tool in a branch": (SRC, "LIN {", "IF b THEN\n$TOOL=TOOL_DATA[1]\nENDIF\nLIN {", WAY),
    "KUKA, tool in a loop": (SRC, "LIN {", "LOOP\nLIN {", WAY),
    "KUKA, tool in a routine": (
        SRC + "DEF sub()\nBAS(#TOOL,1)\nEND\n",
        "LIN {",
        "sub()\nLIN {",
        WAY,
    ),
    "KUKA, tool by the point of an inline form": (
        SRC,
        "LIN {",
        "FDAT_ACT=FP9\nLIN {",
        ["tool is not in this file"],
    ),
    "KUKA, tool of a block": (SRC, "LIN {", "SPLINE WITH $TOOL=TOOL_DATA[2]\nLIN {", ["displaces"] * 2),
    "KUKA, a point with two tools": (
        DAT,
        "ENDDAT",
        "$TOOL=TOOL_DATA[2]\nLIN XP1\nENDDAT",
        ["tool 2 is not in this file"],
    ),
}


@pytest.mark.parametrize("case", BESIDE_MOTIONS)
def test_what_instructions_beside_motions_do_with_targets_refuses_them(case: str, tmp_path: Path) -> None:
    text, old, new, reasons = BESIDE_MOTIONS[case]
    assert old in text
    refused = corrected_as_written(tmp_path, text.replace(old, new, 1)).of(REFUSED)
    assert len(refused) == len(reasons), [(o.target.name, o.why) for o in refused]
    assert all(re.search(reason, o.why) for reason, o in zip(reasons, refused, strict=True)), refused[0].why


def test_what_leaves_a_fanuc_position_as_it_is_refuses_nothing(tmp_path: Path) -> None:
    for more in (
        "Arc Start[1]",
        "Weave Sine[2]",
        "TB .10sec,CALL OPEN(1)",
        "TA 0.2sec,DO[1]=ON",
        "ACC50 Wjnt",
    ):
        text = LS.replace(MOVED, MOVED.replace("FINE", f"FINE {more}"))
        assert corrected_as_written(tmp_path, text).of(REFUSED) == [], more


def test_a_target_that_an_unknown_instruction_drives_to_as_well_is_refused(tmp_path: Path) -> None:
    """Only one of the two motions is read.

    A correction for its tool would be wrong for the tool of the other.
    """
    text = rapid(P1, USE.replace("ENDPROC", "IF TRUE THEN\nWeldAt p1,tGun;\nENDIF\nENDPROC"))
    (refused,) = corrected(tmp_path, "a.mod", text, model_of("abb-irb120")).of(REFUSED)
    assert "'WeldAt' (line 6)" in refused.why
    plain = rapid(P1, USE.replace("ENDPROC", 'IF Distance(p1.trans,[0,0,0])>3 TPWrite "p1";\nENDPROC'))
    left = corrected(tmp_path, "a.mod", plain, model_of("abb-irb120")).of(REFUSED)
    assert not any("not read here" in each.why for each in left)


def test_remarks_displace_nothing(tmp_path: Path) -> None:
    for text, old, new in (
        (RAPID, IN_MAIN, IN_MAIN + '! PDispSet d;\nTPWrite "SpotL p";\n'),
        (LS, MOVED, "   2:  !COORD Offset P[2] ;\n   2:  //L P[2] 100mm/sec FINE RTCP ;\n" + MOVED),
        (SCRIPT, "  movel(p2", "  # servoj(home)\n  movel(p2"),
        (SRC, "PTP {", ";$IPO_MODE=#TCP\nPTP {"),
    ):
        assert old in text
        assert corrected_as_written(tmp_path, text.replace(old, new, 1)).of(REFUSED) == []


@pytest.mark.parametrize(
    ("text", "old", "new", "word"),
    [
        (RAPID, IN_MAIN, IN_MAIN + "GripLoad l;\n", "GripLoad"),
        (LS, MOVED, "   2:  PAYLOAD[3] ;\n" + MOVED, "PAYLOAD[3]"),
        (SCRIPT, "  movel(p2", "  set_target_payload(2.5, [0,0,0.1])\n  movel(p2", "set_target_payload"),
        (SRC, "PTP {", "$LOAD = LOAD_DATA[1]\nPTP {", "$LOAD ="),
        (SRC, "PTP {", "$LOAD_A3.M=2\nPTP {", "$LOAD_A3.M="),
        (RAPID, "tGrip\\WObj", "tGrip\\TLoad:=l\\WObj", "\\TLoad"),
        (RAPID, IN_MAIN, IN_MAIN + "IF b GripLoad l;\n", "GripLoad"),
        (LS, MOVED, "   2:  IF (R[1]=1),PAYLOAD[3] ;\n" + MOVED, "PAYLOAD[3]"),
    ],
)
def test_a_change_of_the_payload_is_named_beside_every_target(
    tmp_path: Path, text: str, old: str, new: str, word: str
) -> None:
    done = corrected_as_written(tmp_path, text.replace(old, new, 1))
    notes = [note for o in done.outcomes for note in o.target.notes]
    assert sum(f"'{word}'" in note and "changes the payload" in note for note in notes) == len(done.outcomes)


def test_a_joint_position_of_val3_that_is_there_twice_is_refused(tmp_path: Path) -> None:
    value = next(line for line in DTX.splitlines(keepends=True) if "<Value" in line and "j6" in line)
    done = corrected(tmp_path, "a.dtx", DTX.replace(value, value + value, 1), a_model("Staubli"))
    assert len(done.of(REFUSED)) == 2
    assert all("more than once" in o.why for o in done.of(REFUSED))


def test_a_posture_that_the_controller_need_not_take_is_named_beside_every_pose(tmp_path: Path) -> None:
    done = corrected_as_written(tmp_path, RAPID.replace(IN_MAIN, IN_MAIN + "ConfL\\Off;\n"))
    named = [
        o.target.name for o in done.outcomes if any("another posture" in note for note in o.target.notes)
    ]
    assert named == ["p1", "p2"]


def test_targets_outside_the_measured_joints_are_marked_and_refused_beyond_a_limit(tmp_path: Path) -> None:
    saved = model_of("abb-irb120")
    saved = replace(saved, covariance=1e-10 * np.eye(len(saved.estimate)))
    narrow = replace(saved, holds_for=saved.holds_for | {"joints": [[-90.0, 90.0]] * 5 + [[-10.0, 10.0]]})
    path = write(tmp_path, "t.csv", TABLE)
    program = read_program(path, saved.model.robot, KnownFrames())
    wide, marked = (compensate(program, path, each, STATED, KnownFrames()) for each in (saved, narrow))
    assert "joint 6" not in str([o.beyond for o in wide.outcomes])
    assert marked.outcomes[0].beyond == ("joint 6",)
    assert "outside measured range: joint 6" in marked.outcomes[0].left
    below = replace(saved, holds_for=saved.holds_for | {"joints": [[-90.0, 90.0]] * 5 + [[70.0, 90.0]]})
    assert compensate(program, path, below, STATED, KnownFrames()).outcomes[0].beyond == ("joint 6",)
    most = marked.outcomes[0].radius_95
    limited = compensate(program, path, narrow, STATED, KnownFrames(), most_mm=0.5 * most)
    refused = {o.target.name: o.why for o in limited.of(REFUSED)}
    assert "joint 6" in refused["a"]
    assert limited.text.splitlines()[1] == TABLE.splitlines()[1], "what is refused stays"


@pytest.mark.parametrize("text", ["1,2,3", "a=1,2,3,4,5,x", "=1,2,3,4,5,inf"])
def test_frames_that_are_none(text: str) -> None:
    with pytest.raises(DataError, match="--tool"):
        named_frames("--tool", [text])


def test_a_frame_given_twice() -> None:
    with pytest.raises(DataError, match="twice"):
        named_frames("--tool", [UTOOL, UTOOL])


def test_a_waypoint_that_two_tools_share_stays_as_it_is(tmp_path: Path) -> None:
    text = SCRIPT.replace(
        "  movel(p2", "  set_tcp(p[0.02, 0, 0.2, 0, 0, 0])\n  movel(p2, a=1.1)\n  movel(p2", 1
    )
    text = text.replace("  movej(home", "  movej(home, a=1.3)\n  movel(p2, a=1.0)\n  movej(home", 1)
    done = corrected_as_written(tmp_path, text)
    (refused,) = done.of(REFUSED)
    assert refused.target.name == "p2"
    assert "two tools" in refused.why
    (before, after) = (next(line for line in of.splitlines() if "p2=" in line) for of in (text, done.text))
    assert after == before
