"""Programs that only an attacker would write.

These would catch: a parser whose time grows with a power of the length (each text here would take it hours). They
would also catch brackets that exhaust the stack, and numbers that no robot has.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from calib import DataError, load_robot
from service.programs import KnownFrames, parse, read_program
from service.programs.program import RobotProgram
from tests.service.robot_programs import EXT, LS, RAPID, SCRIPT, model_of
from tests.service.test_programs import corrected

ROBOTS = {".mod": "abb-irb120", ".ls": "fanuc-lrmate200ic", ".script": "ur5", ".csv": "abb-irb120"}
N = 100_000


def read(suffix: str, text: str) -> RobotProgram:
    return parse(text, Path(f"p{suffix}"), load_robot(ROBOTS[suffix]), KnownFrames())


def ls(positions: str, lines: str = "") -> str:
    return f"/PROG  A\n/MN\n{lines}/POS\n{positions}\n/END\n"


REFUSED = {
    "blanks in a position": (".ls", ls("P[1:" + " " * N), "line 4"),
    "blanks in an empty position": (".ls", ls("P[1:" + " " * N + "]{"), "line 4"),
    "open positions": (".ls", ls("P[1:" * N), "line 4"),
    "open bodies": (".ls", ls("P[1]{" * N), "line 4"),
    "a position behind a letter": (".ls", ls("xP[1]{\n};\nP[2]"), "line 6"),
    "digits of a position": (".ls", ls("P[" + "1" * 5000 + "]{};"), "line 4"),
    "open brackets in RAPID": (".mod", "MODULE M\na{" + "a{" * N, "line 2"),
    "motions without an end": (".mod", "MODULE M\n" + "MoveL p,v,z,t " * (N // 10) + ";", "line 2.*ended"),
    "open brackets in URScript": (".script", "x = 1\nq = " + "[" * N, "line 2"),
    "assignments of open lists": (".script", "a=[\n" * N, "line 1"),
    "columns": (".csv", "target_id," + ",".join(f"c{i}" for i in range(N)), "line 1"),
    "a long line": (".mod", "MODULE M\n!" + "x" * 2_000_000, "line 2"),
}


@pytest.mark.parametrize("case", sorted(REFUSED))
def test_what_nobody_wrote_is_refused_by_its_line(case: str) -> None:
    suffix, text, words = REFUSED[case]
    with pytest.raises(DataError, match=words):
        read(suffix, text)


POINT = "DECL E6POS P1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 35}\n"
ODD = {
    "a status beyond all numbers": (
        ".src",
        "KUKA",
        "$TOOL={X 1,Y 2,Z 3,A 4,B 5,C 6}\n$BASE=$NULLFRAME\n" + POINT.replace("S 2", "S 1E999") + "PTP P1\n",
        "only one of S and T",
    ),
    "a tool of infinite number": (
        ".src",
        "KUKA",
        "DECL FDAT FP1={TOOL_NO 1E999,BASE_NO 0,IPO_FRAME #BASE}\n" + POINT.replace("P1=", "XP1="),
        "tool is not in this file",
    ),
    "one point declared and used again and again": (
        ".src",
        "KUKA",
        "$TOOL={X 1,Y 2,Z 3,A 4,B 5,C 6}\n$BASE=$NULLFRAME\n" + (POINT + "PTP P1\n") * 4_000,
        "",
    ),
    "a word without an end": (
        ".dtx",
        "Staubli",
        '<Database><Data name="a" type="jointRx"><Value ' + "a" * 900_000 + "/></Data></Database>",
        "no j1",
    ),
}


@pytest.mark.timeout(120)  # the last two took a minute and hours
@pytest.mark.parametrize("case", sorted(ODD))
def test_an_odd_program_of_another_maker_is_read_in_time(case: str) -> None:
    suffix, maker, text, why = ODD[case]
    robot = replace(load_robot("abb-irb120"), maker=maker)
    targets = parse(text, Path(f"p{suffix}"), robot, KnownFrames()).targets
    assert targets
    assert all(why in (target.refused or "") for target in targets)


def robtarget(position: str = "[380,0,520]", conf: str = "[0,0,0,0]") -> str:
    return f"MODULE M\nCONST robtarget p:=[{position},[1,0,0,0],{conf},{EXT}];\nMoveL p,v,z,tool0;\n"


def position(values: str, config: str = "N U T, 0, 0, 0") -> str:
    return ls(f"P[1]{{\nGP1:\nUF : 0, UT : 0, CONFIG : '{config}',\n{values}\n}};")


POSE = "X = 300.0 mm, Y = 0.0 mm, Z = 100.0 mm, W = 180.0 deg, P = 0.0 deg, R = 0.0 deg"
TARGETS = {
    "brackets": (".mod", "MODULE M\nCONST robtarget p:=" + "[" * N + "]" * N + ";\n", "brackets"),
    "calls": (".mod", "MODULE M\nMoveL " + "Offs(" * N + ")" * N + ",v,z,t;\n", "computed"),
    "a place beyond the moon": (".mod", robtarget("[1E200,0,0]"), "farther"),
    "a number beyond all": (".mod", robtarget(f"[1{'0' * 400},0,0]"), "larger"),
    "turns without end": (".mod", robtarget(conf="[1E30,0,0,0]"), "quarter"),
    "a long constant": (".mod", f"MODULE M\nCONST pos a:=[{'1,' * N}1];\n" + robtarget("a")[9:], "longer"),
    "a list of lists": (".script", "q = " + "[" * N + "]" * N + "\nmovej(q)", "computed"),
    "motions in motions": (".script", "movej(" * N + ")" * N, "neither"),
    "angles without end": (".script", "movej([1e300,0,0,0,0,0])", "beyond"),
    "a digit too many": (".ls", position(POSE.replace("300.0", "9" * 400)), "farther"),
    "turns of hundreds of digits": (".ls", position(POSE, f"N U T, {'9' * 400}, 0, 0"), "turns"),
    "angles of a table": (
        ".csv",
        "target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\nA,1e300,0,0,0,0,0",
        "beyond",
    ),
}


@pytest.mark.parametrize("case", sorted(TARGETS))
def test_a_target_that_no_robot_has_is_refused_alone(case: str) -> None:
    suffix, text, word = TARGETS[case]
    (target,) = read(suffix, text).targets
    assert word in target.refused


def test_old_line_ends_hide_no_target() -> None:
    """A comment once ran to the end of a file with CR alone.

    All targets after it stayed uncorrected.
    """
    for suffix, text in ((".mod", RAPID), (".script", SCRIPT)):
        wanted = read(suffix, text).targets
        found = read(suffix, text.replace("\n", "\r")).targets
        assert [(t.name, t.line) for t in found] == [(t.name, t.line) for t in wanted]


def test_a_comment_of_a_position_is_its_name() -> None:
    assert [t.name for t in read(".ls", LS).targets][1] == "P[2:name]"


def test_what_is_no_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "folder.mod").mkdir()
    for name, words in (("folder.mod", "folder"), ("none.mod", "no such file")):
        with pytest.raises(DataError, match=words):
            read_program(tmp_path / name, load_robot("abb-irb120"), KnownFrames())


def test_a_number_that_runs_over_two_lines_leaves_the_lines_where_they_are(tmp_path: Path) -> None:
    """Targets without a name are called by their line.

    A line less would rename them in the written program.
    """
    saved = model_of("ur5")
    text = SCRIPT.replace("d2r(-40)", "d2r(\n-40)")
    done = corrected(tmp_path, "a.script", text, saved)
    assert done.text != text
    assert done.text.count("\n") == text.count("\n")
