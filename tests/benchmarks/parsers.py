"""Benchmark of the parsers: growth of their time with hostile input of n, 2n and 4n.

The exponent 1 is linear. A time below a hundredth of a second counts as exponent 0, since a shape that is refused
at once has no meaningful exponent. The limit is 1.35, which no square reaches and noise seldom does.
"""

from __future__ import annotations

import gc
import math
import tempfile
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import openpyxl

from calib import DataError, load_robot
from calib.convert import IMPORTERS
from calib.foreign import propose
from calib.robot_file import import_dh, import_urdf
from calib.text import TextTable, parse_json, parse_toml, rows_of
from calib.watch import read_history
from drivers import ProtocolError
from drivers.bridge import mbp
from drivers.manual.meter import InvalidEntry
from drivers.manual.meter import rows_of as rows_typed
from service.programs import KnownFrames, parse
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
_FRAMES = "$TOOL={X 1,Y 2,Z 3,A 4,B 5,C 6}\n$BASE=$NULLFRAME\n"
KUKA: Mapping[str, Shape] = {
    "points": lambda n: "DECL E6POS XP1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 35}\n" * (n // 50),
    "open aggregates": lambda n: "PTP " + "{" * n,
    "aggregates": lambda n: "PTP " + "{A1 0}" * (n // 6),
    "components": lambda n: "PTP {" + "A1 0," * (n // 5) + "}",
    "quotes": lambda n: '"' * n,
    "blanks": lambda n: "DECL" + " " * n,
    "names": lambda n: "PTP " + "a:" * (n // 2),
    "declared and used": lambda n: (
        _FRAMES + "DECL E6POS P1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 35}\nPTP P1\n" * (n // 1000)
    ),
    "declared and used with frames": lambda n: (
        (_FRAMES + "DECL E6POS P1={X 1,Y 2,Z 3,A 4,B 5,C 6,S 2,T 35}\nPTP P1\n") * (n // 1000)
    ),
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
    "a word": lambda n: '<Database><Data name="a" type="jointRx"><Value ' + "a:" * (n // 2) + ">",
    "values": lambda n: (
        '<Database><Data name="a" type="jointRx">' + '<Value key="0" j1="1"/>' * (n // 23) + "</Data>"
    ),
}
OWN: Mapping[str, Shape] = {
    "rows": lambda n: _HEAD + "P1;1;2;3;4;5;6;7;8;9.5\n" * (n // 20),
    "rows apart by blanks": lambda n: _HEAD.replace(";", " ") + "P1 1 2 3 4 5 6 7 8 9.5\n" * (n // 20),
    "tables": lambda n: (_HEAD + "P1;1;2;3;4;5;6;7;8;9.5\n" * 3) * (n // 100),
    "cells of a line": lambda n: "1 " * (n // 4) + "\n" + _OWN,
    "lines of the preamble": lambda n: "a b\n" * (n // 4) + _OWN,
    "marks behind a unit": lambda n: "unit" + "-" * (n // 5) + "\n" + _OWN,
    "blanks in a bracket": lambda n: "a[" + " " * (n // 5) + "b;" + _OWN,
    "blanks in a name": lambda n: "a" + " \t" * (n // 10) + "b;" + _OWN,
    "brackets in a name": lambda n: "([{" * (n // 15) + ";" + _OWN,
    "marks in the name of a point": lambda n: _OWN.replace("P3", "P" + "-" * (n // 5)),
    "targets in the name of a point": lambda n: _OWN.replace("P3", "P" + "-T1" * (n // 15)),
    "an open quote": lambda n: _OWN + '"' + "x\n" * n,
    "quotes": lambda n: '"' * (n // 5) + "\n" + _OWN,
    "comments": lambda n: "#" * (n // 5) + "\n" + _OWN,
    "digits": lambda n: _OWN.replace("9.5", "9" * (n // 5), 1),
    "one coordinate a line": lambda n: (
        "Name;Axis;Meas;Nom;Dev\n" + "P;X;1;2;3\n;Y;1;2;3\n;Z;1;2;3\n" * (n // 60)
    ),
}
_HEAD = "Name;J1 [deg];J2 [deg];J3 [deg];J4 [deg];J5 [deg];J6 [deg];X [mm];Y [mm];Z [mm]\n"
_OWN = _HEAD + "".join(f"P{i};1;2;3;4;5;{i};7;8;9.5\n" for i in range(20))
SHEET: Mapping[str, Shape] = {
    "rows": lambda n: '<row><c t="n"><v>1</v></c><c><v>2</v></c><c><v>3</v></c></row>' * (n // 100),
    "a far cell": lambda n: f'<row r="{n}"><c r="ALK{n}"><v>1</v></c></row>',
    "merged far": lambda n: f'</sheetData><mergeCells><mergeCell ref="A1:ALK{n}"/></mergeCells><sheetData>',
    "a shared formula": lambda n: (
        f'<row><c><f t="shared" si="0" ref="A1:A{n}">{"A1+" * (n // 60)}1</f></c></row>'
        + '<row><c><f t="shared" si="0"/></c></row>' * (n // 600)
    ),
    "open rows": lambda n: "<row>" * (n // 5),
    "a long text": lambda n: f'<row><c t="inlineStr"><is><t>{"x" * n}</t></is></c></row>',
}
URDF: Mapping[str, Shape] = {
    "links": lambda n: "<robot>" + "".join(f'<link name="a{i}"/>' for i in range(n // 10)) + "</robot>",
    "a chain": lambda n: _robot(n // 60, lambda i: i),
    "a comb": lambda n: _robot(n // 60, lambda i: max(0, i - n // 120)),
    "a ring": lambda n: _robot(n // 60, lambda i: i).replace('parent link="a1"', f'parent link="a{n // 60}"'),
    "open elements": lambda n: "<robot>" + "<link>" * (n // 6),
    "an axis": lambda n: _robot(3, lambda i: i).replace(
        "<child", f'<axis xyz="{"1 " * (n // 2)}"/><child', 1
    ),
    "a name": lambda n: _robot(3, lambda i: i).replace("a2", "a" * n),
}
DH: Mapping[str, Shape] = {
    "columns": lambda n: "alpha,a,theta,d" + ",x" * (n // 200) + "\n0,0,0,0\n",
    "blanks in a heading": lambda n: "alpha [" + " " * (n // 5) + "deg],a,theta,d\n0,0,0,0\n",
    "a term": lambda n: "alpha,a,theta,d\n" + "-" * (n // 5) + ",0,0,0\n",
    "rows": lambda n: "alpha,a,theta,d\n" + "0,0,0,0\n" * (n // 8),
}
WATCHES: Mapping[str, Shape] = {
    "lines": lambda n: _WATCH.replace("[]", "[0.5,1.5]") * (n // 100),
    "residuals": lambda n: _WATCH.replace("[]", "[" + "1.5," * n + "1]"),
    "brackets": lambda n: _WATCH.replace("[]", "[" * n),
    "digits": lambda n: _WATCH.replace("[]", "[" + "9" * n + "]"),
}
_WATCH = (
    '{"format":"truepose-watch-history/1","data_sha256":"a","baseline_sha256":"b","poses_sha256":"c",'
    '"verdict":"unchanged","residual":[]}\n'
)
TYPED: Mapping[str, Shape] = {
    "numbers": lambda n: "1 " * n,
    "digits": lambda n: "9" * n,
    "blanks": lambda n: " " * n + "1",
    "names": lambda n: "X=" * n,
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
        ("columns of a data set", TABLE, partial(_of_file, TextTable.read)),
        ("published readings", TABLE, partial(_of_file, IMPORTERS["ipa-ur10"])),
        *(
            (f"program {Path(name).suffix}", programs[Path(name).suffix], partial(_program, name, robot))
            for name, robot in robots.items()
        ),
        *(
            (f"program {Path(name).suffix}", shapes, partial(_of_maker, name))
            for name, shapes in others.items()
        ),
        ("own file", OWN, partial(_of_file, lambda path: propose([path], {}))),
        ("workbook", SHEET, _workbook),
        ("URDF", URDF, partial(_of_file, import_urdf)),
        ("table of DH numbers", DH, partial(_of_file, lambda path: import_dh(path, "dh"))),
        ("history of watches", WATCHES, partial(_of_file, read_history)),
        ("typed numbers", TYPED, _typed),
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


def _workbook(text: str) -> object:
    """The proposal for a workbook whose sheet has these rows."""
    with tempfile.TemporaryDirectory() as folder:
        good, path = Path(folder) / "good.xlsx", Path(folder) / "data.xlsx"
        openpyxl.Workbook().save(good)
        with zipfile.ZipFile(good) as given, zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as packed:
            for name in given.namelist():
                part = given.read(name)
                if name == "xl/worksheets/sheet1.xml":
                    part = part.replace(b"<sheetData></sheetData>", f"<sheetData>{text}</sheetData>".encode())
                    assert text.encode() in part
                packed.writestr(name, part)
        return propose([path], {})


def _robot(count: int, parent: Callable[[int], int]) -> str:
    """Write a URDF of fixed joints.

    `parent` gives, for each link from a1 on, the number of the link that carries it.
    """
    links = "".join(f'<link name="a{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="fixed"><parent link="a{parent(i)}"/><child link="a{i + 1}"/></joint>'
        for i in range(count)
    )
    return f"<robot>{links}{joints}</robot>"


def _typed(text: str) -> object:
    try:
        return rows_typed(text, ("X", "Y", "Z"), "mm")
    except InvalidEntry:
        return None


def _of_maker(name: str, text: str) -> object:
    robot = replace(
        load_robot("abb-irb120"), maker={".src": "KUKA", ".jbi": "Yaskawa", ".dtx": "Staubli"}[name[1:]]
    )
    return parse(text, Path(name), robot, KnownFrames(pulses_per_deg=(1000.0,) * 6))


def _program(name: str, robot: str, text: str) -> object:
    return parse(text, Path(name), load_robot(robot), KnownFrames())
