"""Round trips of programs drawn from the grammars, and of odd ones by hand.

They come back byte for byte when nothing is corrected; otherwise only the numbers of their targets change. These would
catch a lexer that swallows or reorders text, a line end or an encoding that changes, and a target that is overlooked.
"""

from __future__ import annotations

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calib.model.model import StatedConditions
from service.programs import KnownFrames, compensate, named_frames, read_program, rewritten, write_text
from service.programs.compensation import CORRECTED, EMPTY
from tests.service.robot_programs import EXT, LS, RAPID, SCRIPT, TABLE, model_of

IRB, LR_MATE, UR5 = (model_of(name) for name in ("abb-irb120", "fanuc-lrmate200ic", "ur5"))
STATED = StatedConditions(temperature_c=22.0)
KNOWN = KnownFrames(
    named_frames("--tool", ["1=5,-10,120,10,20,30"]), named_frames("--frame", ["2=50,20,-15,0,5,40"])
)
NUMBER = re.compile(r"(?<![\w.])[-+]?(?:\d+\.?\d*|\.\d+)(?:E\+?\d+)?", re.IGNORECASE)


def skeleton(text: str) -> str:
    """The text without its numbers and the blanks that pad them."""
    return re.sub(r"[ ]+", " ", NUMBER.sub("#", text))


def round_trip(folder: Path, name: str, data: bytes) -> None:
    """Check that reading and writing keep the bytes, and that a correction changes numbers only.

    Every target must be corrected or empty.
    """
    path, out = folder / name, folder / f"out_{name}"
    path.write_bytes(data)
    saved = {".mod": IRB, ".ls": LR_MATE, ".script": UR5, ".csv": IRB}[path.suffix]
    program = read_program(path, saved.model.robot, KNOWN)
    write_text(out, rewritten(program, {}))
    assert out.read_bytes() == data
    done = compensate(program, path, saved, STATED, KNOWN)
    assert {o.status for o in done.outcomes} <= {CORRECTED, EMPTY}, [o.why for o in done.outcomes]
    write_text(out, done.text)
    assert out.read_bytes() != data
    old, new = (d.decode("utf-8", errors="surrogateescape") for d in (data, out.read_bytes()))
    assert skeleton(new) == skeleton(old)


angle = st.floats(-50.0, 50.0).map(lambda v: round(v, 3))
away = st.one_of(st.floats(15.0, 50.0), st.floats(-50.0, -15.0)).map(lambda v: round(v, 3))
joints = st.tuples(angle, angle.map(abs), angle.map(lambda v: 0.4 * v - 10.0), angle, away, angle)
# The same on the LR Mate, whose J3 counts from the horizontal: wrist before axis 1, arm bent, nothing refused.
counted = joints.map(lambda q: (*q[:2], round(-q[1] - q[2], 3), *q[3:]))
BLANK = st.sampled_from(["", " ", "\t", "  "])
NEWLINE = st.sampled_from(["\n", "\r\n"])
NUMBERS = ("{:.3f}", "{:g}", "{:.6f}", "{:.1f}")


@st.composite
def rapid_modules(draw: st.DrawFn) -> tuple[str, int]:
    """Draw a module and the number of its targets.

    Targets are named, in arrays or in place, with comments, cases, blanks and continued lines.
    """
    count = 0
    declared, moved = [], []
    for i in range(draw(st.integers(1, 5))):
        blank = draw(BLANK)
        scope = draw(st.sampled_from(["", "LOCAL ", "TASK ", "local "]))
        kind = draw(st.sampled_from(["CONST", "PERS", "VAR", "const"]))
        size = draw(st.integers(1, 3))
        values = []
        for _ in range(size):
            form = draw(st.sampled_from(NUMBERS))
            row = f",{blank}".join(form.format(v) for v in draw(joints))
            values.append(f"[{blank}[{row}]{draw(st.sampled_from([',', f',{blank}', f'{blank},']))}{EXT}]")
        count += size
        use = f"q{i}"
        if size == 1 and draw(st.booleans()):
            declared.append(f"{scope}{kind} jointtarget q{i}{blank}:={blank}{values[0]};")
        else:
            inner = draw(st.sampled_from([", ", ",\n     ", ",  ! next\n"])).join(values)
            declared.append(f"{scope}{kind}  jointtarget q{i}{{{size}}}{blank}:= [{inner}]{blank};")
            use = f"q{i}{{1}}"
        moved.append(f"MoveAbsJ{draw(st.sampled_from([' ', '  ']))}{use}\\NoEOffs,{blank}v100,fine,tool0;")
        if draw(st.booleans()):
            moved.append(
                draw(st.sampled_from(['TPWrite "[[1,2],3];";', "! MoveJ [[1,2,3]];", "WaitTime 0.5;"]))
            )
    lines = ["MODULE Drawn", *declared, "PROC main()", *moved, "ENDPROC", "ENDMODULE", ""]
    return draw(NEWLINE).join("\n".join(lines).split("\n")), count


@st.composite
def ls_programs(draw: st.DrawFn) -> tuple[str, int]:
    """Draw a listing and the number of its positions.

    Comments, groups, tabs and leading zeros are drawn or left out.
    """
    positions = []
    for number in range(1, draw(st.integers(2, 6))):
        values = draw(counted)
        text = [f"{v:9.3f}" for v in values]
        if draw(st.booleans()):
            text = [re.sub(r"(^|[ -])0\.", r"\1.", t) for t in text]
        blank = draw(st.sampled_from(["\t", "  ", "    "]))
        comment = draw(st.sampled_from(["", ':"here"', ":there", ":"]))
        groups = ["   GP1:", f"{blank}UF : 0, UT : 1,\t"]
        pairs = [f"J{k}= {t} deg" for k, t in enumerate(text, start=1)]
        groups.append(f"{blank}{', '.join(pairs[:3])},")
        groups.append(f"{blank}{', '.join(pairs[3:])}" + draw(st.sampled_from(["", ",\n\tE1=   .000 mm"])))
        if draw(st.booleans()):
            groups += ["   GP2:", f"{blank}UF : 0, UT : 1,", f"{blank}J1=   12.000 deg,  J2=    -.500 deg"]
        positions.append("\n".join([f"P[{number}{comment}]{{", *groups, "};"]))
    uses = [f"{k:4d}:J P[{k}] {10 * k}% FINE    ;" for k in range(1, len(positions) + 1)]
    lines = ["/PROG  DRAWN", "/ATTR", "LINE_COUNT = 0;", "/MN", *uses, "/POS", *positions, "/END", ""]
    return draw(NEWLINE).join("\n".join(lines).split("\n")), len(positions)


@settings(max_examples=20)
@given(rapid_modules(), ls_programs())
def test_drawn_programs(module: tuple[str, int], listing: tuple[str, int]) -> None:
    with TemporaryDirectory() as folder:
        for (text, count), ending, robot in ((module, "mod", IRB), (listing, "ls", LR_MATE)):
            round_trip(Path(folder), f"a.{ending}", text.encode("utf-8"))
            path = Path(folder) / f"b.{ending}"
            path.write_bytes(text.encode("utf-8"))
            assert len(read_program(path, robot.model.robot, KNOWN).targets) == count


PLAIN = RAPID.replace("zSafe]", "520]")
BY_HAND = {
    "lines of DOS": ("a.mod", PLAIN.replace("\n", "\r\n").encode()),
    "byte order mark": ("a.mod", b"\xef\xbb\xbf" + PLAIN.encode()),
    "Latin-1 in a comment": ("a.mod", PLAIN.replace("a comment", "\xfcber").encode("latin-1")),
    "small letters": ("a.mod", PLAIN.lower().replace("9e9", "9E9").encode()),
    "one line": ("a.mod", re.sub(r"! (CONST|continued).*", "", PLAIN).replace("\n", " ").encode()),
    "no line end at the end": ("a.mod", PLAIN.rstrip().encode()),
    "system module": (
        "a.mod",
        PLAIN.replace("MODULE CalTargets", "MODULE BASE (SYSMODULE, NOSTEPIN)").encode(),
    ),
    "listing with lines of DOS": ("a.ls", LS.replace("\n", "\r\n").encode()),
    "listing with blanks for tabs": ("a.ls", LS.replace("\t", "    ").encode()),
    "listing with a Latin-1 comment": ("a.ls", LS.replace("bare", "L\xf6ten").encode("latin-1")),
    "listing without group names": (
        "a.ls",
        LS.replace("   GP1:\n", "", 1).replace("   GP2:", "   GP3:").encode(),
    ),
    "script with lines of DOS": (
        "a.script",
        SCRIPT.replace("d2r(-40)", "-0.7").replace("\n", "\r\n").encode(),
    ),
    "table with lines of DOS": ("t.csv", TABLE.replace("\n", "\r\n").encode()),
    "table with a byte order mark": ("t.csv", b"\xef\xbb\xbf" + TABLE.encode()),
}


@pytest.mark.parametrize("case", BY_HAND)
def test_by_hand(case: str, tmp_path: Path) -> None:
    name, data = BY_HAND[case]
    if case == "listing without group names":  # the first body then holds two groups' values
        data = data.replace(b"   GP3:\n\tUF : 0, UT : 1,\n\tJ1=     5.000 deg\n", b"")
    round_trip(tmp_path, name, data)
