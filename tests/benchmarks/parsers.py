"""How the time of every parser grows with what it is given: hostile shapes at n, 2n and 4n, and the exponent.

1 is linear. A shape that is refused at once has no exponent to speak of: what takes less than a hundredth of a second
counts as 0. At most 1.35 is taken, which no square reaches and noise seldom does.
"""

from __future__ import annotations

import gc
import math
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from calib.arm.robot import load_robot
from calib.convert import IMPORTERS
from calib.errors import DataError
from calib.text.columns import Columns
from calib.text.csv_text import rows_of
from calib.text.json_text import parse_json
from calib.text.toml_text import parse_toml
from drivers.bridge import mbp
from drivers.errors import ProtocolError
from service.programs import KnownFrames
from service.programs.read import parse
from tests.benchmarks.clock import line, seconds

MOST = 1.35
LEAST_S = 0.01
SIZE = 100_000
Shape = Callable[[int], str]

JSON: Mapping[str, Shape] = {
    "brackets": lambda n: "[" * n + "]" * n,
    "digits": lambda n: "9" * n,
    "keys": lambda n: "{" + ",".join(f'"k{i}":1' for i in range(n // 10)) + "}",
    "the same key": lambda n: "{" + ",".join('"k":1' for _ in range(n // 10)) + "}",
    "text": lambda n: '"' + "\\n" * n + '"',
    "numbers": lambda n: "[" + "1.5," * n + "0]",
}
TOML: Mapping[str, Shape] = {
    "brackets": lambda n: "a=" + "[" * n,
    "inline tables": lambda n: "a=" + "{b=" * n,
    "dotted key": lambda n: "a." * n + "a=1",
    "dotted table": lambda n: "[" + "a." * n + "a]",
    "dotted key in a table": lambda n: "a={" + "b . " * n + "b=1}",
    "dotted text": lambda n: "a='" + "x." * n + "'",
    "words without dots": lambda n: "x" * n,
    "quotes": lambda n: '"' * n,
    "quoted words": lambda n: "a=[" + '"x y",' * n + "]",
    "tables": lambda n: "".join(f"[t{i}]\n" for i in range(n // 10)),
    "arrays of tables": lambda n: "[[t]]\n" * (n // 10),
    "keys": lambda n: "".join(f"k{i}=1\n" for i in range(n // 10)),
    "digits": lambda n: "a=" + "9" * n,
    "numbers": lambda n: "a=[" + "1.5," * n + "]",
    "blanks": lambda n: "a" + " " * n + "=" + " " * n + "\n" * n,
}
TABLE: Mapping[str, Shape] = {
    "columns": lambda n: "target_id," + ",".join(f"c{i}" for i in range(n)),
    "columns within bounds": lambda n: "\n".join(
        ",".join(f"c{i}" for i in range(900)) for _ in range(n // 2000)
    ),
    "the same column": lambda n: "target_id," + "c," * n,
    "quotes": lambda n: "target_id\n" + '"' * n,
    "quoted cells": lambda n: "target_id\n" + '"a","' * n,
    "an open quote": lambda n: 'target_id\n"' + "x\n" * n,
    "rows": lambda n: (
        "target_id,j1_deg,j2_deg,j3_deg,j4_deg,j5_deg,j6_deg\n"
        + "".join(f"t{i},1,2,3,4,5,6\n" for i in range(n // 20))
    ),
    "blank lines": lambda n: "target_id,x\n" + "\n" * n,
    "blanks": lambda n: "target_id,x\n" + " " * n,
}
RAPID: Mapping[str, Shape] = {
    "brackets": lambda n: "MODULE M\nCONST robtarget p:=" + "[" * n + "]" * n + ";",
    "open brackets": lambda n: "MODULE M\nCONST robtarget p:=" + "[" * n + ";",
    "indices": lambda n: "MODULE M\n" + "a{" * n + "}" * n + ":=1;",
    "open indices": lambda n: "MODULE M\n" + "a{" * n,
    "calls": lambda n: "MODULE M\nMoveL " + "Offs(" * n + ")" * n + ";",
    "members": lambda n: "MODULE M\n" + "a." * n + "b:=1;",
    "motions without an end": lambda n: "MODULE M\n" + "MoveL p,v,z,t " * (n // 10) + ";",
    "motions": lambda n: "MODULE M\n" + "MoveL p,v,z,t;\n" * (n // 10),
    "declarations": lambda n: "MODULE M\n" + "".join(f"CONST num a{i}:=1;\n" for i in range(n // 10)),
    "declarations without an end": lambda n: "MODULE M\n" + "CONST num a:=1 " * (n // 10) + ";",
    "targets": lambda n: (
        "MODULE M\n"
        + "".join(
            f"CONST robtarget p{i}:=[[1,2,3],[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\nMoveL p{i},v,z,tool0;\n"
            for i in range(n // 200)
        )
    ),
    "a long constant": lambda n: (
        "MODULE M\nCONST pos a:=["
        + "1," * n
        + "1];\n"
        + "".join(
            f"CONST robtarget p{i}:=[a,[1,0,0,0],[0,0,0,0],[9E9,9E9,9E9,9E9,9E9,9E9]];\n"
            for i in range(n // 200)
        )
    ),
    "digits": lambda n: "MODULE M\nCONST num a:=" + "9" * n + ";",
    "strings": lambda n: "MODULE M\n" + '"a" ' * n,
    "commas": lambda n: "MODULE M\nMoveL " + "," * n + ";",
}
URSCRIPT: Mapping[str, Shape] = {
    "brackets": lambda n: "q=" + "[" * n + "]" * n,
    "open brackets": lambda n: "q=" + "[" * n,
    "indices": lambda n: "a[" * n + "]" * n + "=1",
    "motions in motions": lambda n: "movej(" * n + ")" * n,
    "tools in tools": lambda n: "set_tcp(" * n + ")" * n,
    "assignments": lambda n: "a=1\n" * (n // 4),
    "assignments on a line": lambda n: "a=" * (n // 4),
    "assignments of open lists": lambda n: "a=[\n" * (n // 4),
    "waypoints": lambda n: "".join(f"q{i}=[1,2,3,4,5,6]\nmovej(q{i})\n" for i in range(n // 40)),
    "waypoints in place": lambda n: "movej([1,2,3,4,5,6])\n" * (n // 40),
    "calls": lambda n: "movej(" + "f(" * n + ")" * n + ")",
}
_LS = "/PROG  A\n/MN\n{}/POS\n{}/END\n"
FANUC: Mapping[str, Shape] = {
    "blanks in a position": lambda n: _LS.format("", "P[1:" + " " * n),
    "blanks in a closed position": lambda n: _LS.format("", "P[1:" + " " * n + "]{"),
    "blanks everywhere": lambda n: _LS.format("", ("P[1 " + " " * 9 + ":" + " " * 9) * (n // 20)),
    "open positions": lambda n: _LS.format("", "P[1:" * n),
    "open bodies": lambda n: _LS.format("", "P[1]{" * n),
    "digits": lambda n: _LS.format("", "P[" + "1" * n + "]{};"),
    "values": lambda n: _LS.format("", "P[1]{" + "X = " * n + "};"),
    "open configurations": lambda n: _LS.format(
        "", "P[1]{UF:0,UT:1,CONFIG:'" + " " * n + "X=1,Y=1,Z=1,W=1,P=1,R=1};"
    ),
    "uses": lambda n: _LS.format("L INC " + "P[1" * n + ";\n", ""),
    "incremental uses": lambda n: _LS.format("L P[1] INC;\n" * (n // 12), ""),
    "positions": lambda n: _LS.format(
        "",
        "".join(
            f"P[{i}]{{\nJ1=1 deg,J2=1 deg,J3=1 deg,J4=1 deg,J5=1 deg,J6=1 deg\n}};\n" for i in range(n // 60)
        ),
    ),
    "groups": lambda n: _LS.format("", "P[1]{" + "GP2:" * n + "};"),
}
KUKA: Mapping[str, Shape] = {
    "points": lambda n: "DECL E6POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 35}\n" * (n // 50),
    "open aggregates": lambda n: "PTP " + "{" * n,
    "aggregates": lambda n: "PTP " + "{A1 0}" * (n // 6),
    "components": lambda n: "PTP {" + "A1 0," * (n // 5) + "}",
    "quotes": lambda n: '"' * n,
    "blanks": lambda n: "DECL" + " " * n,
    "names": lambda n: "PTP " + "a:" * (n // 2),
    "tools": lambda n: "$TOOL={X 1,Y 2,Z 3,A 4,B 5,C 6}\nPTP P1\n" * (n // 40),
}
YASKAWA: Mapping[str, Shape] = {
    "pulses": lambda n: "/JOB\n//POS\n///POSTYPE PULSE\nC00000=" + "1," * (n // 2),
    "positions": lambda n: "/JOB\n//POS\n///POSTYPE PULSE\n" + "C00000=1,2,3,4,5,6\n" * (n // 19),
    "blanks": lambda n: "/JOB\n//POS\nC00000" + " " * n,
}
VAL3: Mapping[str, Shape] = {
    "open tags": lambda n: "<Database>" + "<Data " * (n // 6),
    "comments": lambda n: "<Database>" + "<!--" * (n // 4),
    "dashes": lambda n: "<Database><!--" + "-" * n,
    "attributes": lambda n: '<Database><Data name="a" type="jointRx"><Value ' + 'a="1" ' * (n // 6) + ">",
    "values": lambda n: (
        '<Database><Data name="a" type="jointRx">' + '<Value key="0" j1="1"/>' * (n // 23) + "</Data>"
    ),
}
MBP: Mapping[str, Shape] = {
    "fields": lambda n: "1 OK " + "a=1 " * n,
    "a name": lambda n: "1 OK " + "a" * n,
    "a text": lambda n: '1 OK a="' + "x" * n,
}


def run() -> bool:
    """Print the exponents of every format and shape."""
    robots = {"p.mod": "abb-irb120", "p.ls": "fanuc-lrmate200ic", "p.script": "ur5", "p.csv": "abb-irb120"}
    programs = {".mod": RAPID, ".ls": FANUC, ".script": URSCRIPT, ".csv": TABLE}
    others = {"p.src": KUKA, "p.jbi": YASKAWA, "p.dtx": VAL3}
    reached = True
    for what, shapes, read in (
        ("JSON", JSON, lambda text: parse_json(text, "f")),
        ("TOML", TOML, lambda text: parse_toml(text, "f")),
        ("CSV", TABLE, lambda text: rows_of(text, "f")),
        ("columns of a data set", TABLE, partial(_of_file, Columns.read)),
        ("published readings", TABLE, partial(_of_file, IMPORTERS["ipa-ur10"])),
        *(
            (f"program {Path(name).suffix}", programs[Path(name).suffix], partial(_program, name, robot))
            for name, robot in robots.items()
        ),
        *(
            (f"program {Path(name).suffix}", shapes, partial(_of_maker, name))
            for name, shapes in others.items()
        ),
        ("a bridge's line", MBP, lambda text: mbp.parse(text.encode())),
    ):
        for shape, text in shapes.items():
            times = [_time(read, text(SIZE * k)) for k in (1, 2, 4)]
            exponent = _exponent(times)
            reached &= exponent <= MOST
            shown = "  ".join(f"{1e3 * t:.0f}" for t in times)
            line(f"{what}: {shape} ({shown} ms)", f"{exponent:.2f}", f"<= {MOST}", exponent <= MOST)
    return reached


def _time(read: Callable[[str], object], text: str) -> float:
    def attempt() -> None:
        try:
            read(text)
        except (DataError, ProtocolError):
            return

    gc.disable()  # as timeit: it looks at all there is ever more often, and adds a power of its own
    try:
        return seconds(attempt, tries=2)
    finally:
        gc.enable()


def _exponent(times: list[float]) -> float:
    """Slope of log time over log size; 0 where it is over before anybody notices."""
    if times[-1] < LEAST_S:
        return 0.0
    return float(np.polyfit([0.0, math.log(2.0), math.log(4.0)], np.log(np.maximum(times, 1e-4)), 1)[0])


def _of_file(read: Callable[[Path], object], text: str) -> object:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "data.csv"
        path.write_text(text, "utf-8")
        return read(path)


def _of_maker(name: str, text: str) -> object:
    robot = replace(
        load_robot("abb-irb120"), maker={".src": "KUKA", ".jbi": "Yaskawa", ".dtx": "Staubli"}[name[1:]]
    )
    return parse(text, Path(name), robot, KnownFrames(pulses_per_deg=(1000.0,) * 6))


def _program(name: str, robot: str, text: str) -> object:
    return parse(text, Path(name), load_robot(robot), KnownFrames())
