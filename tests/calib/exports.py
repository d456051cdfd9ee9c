"""Measurements as people export them: one true campaign written in some forty ways, each with what must come of it.

The numbers are of a simulated robot with errors of its own, so that what is read can be held against what was true. The
forms follow the descriptions of the programs' exports and spreadsheets as they come by mail; none is a maker's own
file.
"""

from __future__ import annotations

import re
import zipfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import forward
from calib.arm.robot import load_robot
from calib.array import Array
from calib.units import DEG

N = 24
ROBOT = "abb-irb120"
TARGETS = np.array([[30.0, 0.0, 120.0], [-40.0, 25.0, 110.0], [0.0, -50.0, 140.0]])
LEFT_OUT = 5  # a row that some files mark as not measured


@dataclass(frozen=True)
class Truth:
    """joints (n, 6) deg; points (n, 3 targets, 3) mm; turns (n, 4) scalar first."""

    joints: Array
    points: Array
    turns: Array


def truth() -> Truth:
    """The campaign: a placed robot, a turned tool, 0.3 mm of errors that no model has, rounded to what files hold."""
    rng = np.random.default_rng(21)
    robot = load_robot(ROBOT)
    lower, upper = np.array(robot.lower) / DEG, np.array(robot.upper) / DEG
    joints = np.round(rng.uniform(0.6 * lower, 0.6 * upper, (N, 6)), 3)
    joints[0] = (100.125, 40.5, -30.25, 120.75, 60.5, 170.875)
    flange = forward(robot, joints * DEG)
    turn = Rotation.from_rotvec([0.3, -0.5, 1.1])
    local = flange[:, None, :3, 3] + np.einsum("nij,tj->nti", flange[:, :3, :3], TARGETS)
    points = local @ turn.as_matrix().T + (2500.0, -1200.0, 300.0) + rng.normal(0.0, 0.3, local.shape)
    measured = turn * Rotation.from_matrix(flange[:, :3, :3]) * Rotation.from_rotvec([0.2, 0.1, -0.4])
    measured = Rotation.from_rotvec(rng.normal(0.0, 5e-4, (N, 3))) * measured
    return Truth(joints, np.round(points, 4), measured.as_quat(scalar_first=True))


TRUTH = truth()
OWN = forward(load_robot(ROBOT), TRUTH.joints * DEG)[:, :3, 3]  # what the controller shows


@dataclass(frozen=True)
class Case:
    """One export. write: makes the files; answers: what the person gives beside the robot; asks: keys of the questions
    that must be put before; refuses: what the refusal must say, where it must be refused; targets: of the truth that
    the files hold; within: of the points, mm; turned: whether orientations are there; lost, rejected: rows that are;
    lost_rows: rows of which nothing comes."""

    name: str
    shape: str
    write: Callable[[Path], Sequence[Path]]
    answers: dict[str, str] = field(default_factory=dict)
    asks: tuple[str, ...] = ()
    refuses: str = ""
    targets: int = 1
    within: float = 1e-3
    turned: bool = False
    lost: tuple[int, ...] = ()
    lost_rows: tuple[int, ...] = ()
    rejected: tuple[int, ...] = ()


CASES: list[Case] = []


def case(shape: str, **expected: Any) -> Callable[[Callable[[Path], Any]], None]:
    def add(write: Callable[[Path], Any]) -> None:
        def files(folder: Path) -> Sequence[Path]:
            made = write(folder)
            return [made] if isinstance(made, Path) else made

        CASES.append(Case(write.__name__, shape, files, **expected))

    return add


def save(path: Path, lines: Sequence[str], encoding: str = "utf-8", end: str = "\n") -> Path:
    path.write_bytes((end.join(lines) + end).encode(encoding))
    return path


def num(value: float, decimals: int = 4, comma: bool = False, thousands: str = "") -> str:
    text = f"{value:,.{decimals}f}"
    marks = {",": thousands, ".": "," if comma else "."}
    return "".join(marks.get(c, c) for c in text)


def grid(*parts: NDArray[Any], decimals: int = 6) -> list[list[str]]:
    return [[f"{value:.{decimals}f}" for value in row] for row in np.column_stack(parts)]


def named(names: Sequence[str], rows: Sequence[Sequence[str]], separator: str = ";") -> list[str]:
    return [separator.join(row) for row in (names, *rows)]


J, P, Q = TRUTH.joints, TRUTH.points[:, 0], TRUTH.turns
HEAD = [*(f"J{k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
BODY = [[*J[i].tolist(), *P[i].tolist()] for i in range(N)]
AXES = [f"A{k}" for k in range(1, 7)]


def angles(sequence: str) -> Array:
    return Rotation.from_quat(Q, scalar_first=True).as_euler(sequence, degrees=True)


@case("German Excel: semicolons, decimal commas, Latin-1, CRLF, a preamble, names with units")
def excel_german(folder: Path) -> Path:
    names = ["Nr.", *(f"Achse {k} [°]" for k in range(1, 7)), *(f"Pos. {a} [mm]" for a in "XYZ"), "Prüfer"]
    rows = [[str(i + 1), *(num(v, comma=True) for v in (*J[i], *P[i])), "Müller"] for i in range(N)]
    head = ["Messprotokoll Roboterzelle 4", "Datum: 12.03.2025;Prüfer: Müller", ""]
    return save(folder / "messung.csv", [*head, *named(names, rows)], "cp1252", "\r\n")


@case("Tabs, a row of units below the names, UTF-8 with BOM")
def tabs_units(folder: Path) -> Path:
    lines = named([*(f"J{k}" for k in range(1, 7)), "X", "Y", "Z"], grid(J, P), "\t")
    return save(folder / "a.txt", [lines[0], "\t".join(["deg"] * 6 + ["mm"] * 3), *lines[1:]], "utf-8-sig")


@case("Blanks in columns, names in a comment")
def blanks(folder: Path) -> Path:
    rows = [" ".join(f"{v:12.5f}" for v in (*J[i], *P[i])) for i in range(N)]
    return save(folder / "a.dat", ["# j1_deg j2_deg j3_deg j4_deg j5_deg j6_deg x_mm y_mm z_mm", *rows])


@case("Excel's Unicode text: UTF-16, tabs, decimal commas")
def utf16(folder: Path) -> Path:
    names = [*(f"Gelenk {k} (Grad)" for k in range(1, 7)), "x (mm)", "y (mm)", "z (mm)"]
    rows = [[num(v, comma=True) for v in (*J[i], *P[i])] for i in range(N)]
    return save(folder / "a.txt", named(names, rows, "\t"), "utf-16")


@case("UR's names from 0, radians; the tracker in metres")
def ur_radians(folder: Path) -> Path:
    names = [
        "timestamp",
        *(f"target_q_{k}" for k in range(6)),
        *(f"actual_q_{k}" for k in range(6)),
        *(f"{a} [m]" for a in "xyz"),
    ]
    back = J * DEG + 1e-5
    rows = grid(np.arange(N) * 20.0, J * DEG, back, P / 1000.0, decimals=8)
    return save(folder / "rtde.csv", named(names, rows, ","))


@case("No units anywhere: degrees are evident, millimetres are told by the robot")
def no_units(folder: Path) -> Path:
    return save(
        folder / "a.csv", named([*(f"theta{k}" for k in range(1, 7)), "X", "Y", "Z"], grid(J, P), ",")
    )


@case(
    "No units, and no robot that could tell",
    asks=("unit.points", "robot"),
    answers={"robot": "", "unit.points": "mm"},
)
def no_units_no_robot(folder: Path) -> Path:
    return save(
        folder / "a.csv", named([*(f"theta{k}" for k in range(1, 7)), "X", "Y", "Z"], grid(J, P), ",")
    )


@case("Names say deg, numbers are radians")
def deg_that_are_rad(folder: Path) -> Path:
    names = [*(f"Joint {k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
    return save(folder / "a.csv", named(names, grid(J * DEG, P, decimals=8), ";"))


@case("Names say mm, numbers are metres")
def mm_that_are_m(folder: Path) -> Path:
    names = [*(f"Joint {k} [deg]" for k in range(1, 7)), "X [mm]", "Y [mm]", "Z [mm]"]
    return save(folder / "a.csv", named(names, grid(J, P / 1000.0, decimals=8), ";"))


@case("Inches", within=2e-3)
def inches(folder: Path) -> Path:
    names = [*(f"Axis{k} [deg]" for k in range(1, 7)), "X (in)", "Y (in)", "Z (in)"]
    return save(folder / "a.csv", named(names, grid(J, P / 25.4), ","))


@case("KUKA: A1 .. A6 beside the controller's X, Y, Z, A, B, C and what the tracker measured")
def kuka(folder: Path) -> Path:
    own = grid(OWN, angles("ZYX") + 3.0)
    names = ["Punkt", *(f"{n} [deg]" for n in AXES), *(f"{a} soll [mm]" for a in "XYZ")]
    names += ["A [deg]", "B [deg]", "C [deg]", *(f"{a}_ist [mm]" for a in "XYZ")]
    rows = [[f"P{i + 1}", *grid(J)[i], *own[i], *grid(P)[i]] for i in range(N)]
    return save(folder / "kuka.csv", named(names, rows))


@case("Nominal, actual and deviation side by side (as of inspection programs)")
def nominal_actual(folder: Path) -> Path:
    names = ["Name", *(f"J{k} (deg)" for k in range(1, 7))]
    names += [f"{kind} {a}" for a in "XYZ" for kind in ("Nom", "Act", "Dev")]
    rows = []
    for i in range(N):
        of = [(OWN[i, k], P[i, k], P[i, k] - OWN[i, k]) for k in range(3)]
        rows.append([f"M{i}", *grid(J)[i], *(f"{v:.4f}" for each in of for v in each)])
    return save(folder / "report.txt", ["// Units: mm", *named(names, rows, "\t")])


@case("rx, ry, rz in degrees: the robot tells Staubli's convention", turned=True)
def euler_staubli(folder: Path) -> Path:
    names = [*(f"J{k}_deg" for k in range(1, 7)), "x_mm", "y_mm", "z_mm", "rx_deg", "ry_deg", "rz_deg"]
    return save(folder / "a.csv", named(names, grid(J, P, angles("XYZ")), ","))


@case("rx, ry, rz in radians: the robot tells a rotation vector", turned=True)
def euler_vector(folder: Path) -> Path:
    vector = Rotation.from_quat(Q, scalar_first=True).as_rotvec()
    names = [
        *(f"J{k} [deg]" for k in range(1, 7)),
        "x [m]",
        "y [m]",
        "z [m]",
        "rx [rad]",
        "ry [rad]",
        "rz [rad]",
    ]
    return save(folder / "a.csv", named(names, grid(J, P / 1000.0, vector, decimals=8), ","))


@case("Fanuc's W, P, R", turned=True)
def euler_fanuc(folder: Path) -> Path:
    names = [
        *(f"J{k} [deg]" for k in range(1, 7)),
        *(f"{a} [mm]" for a in "XYZ"),
        "W [deg]",
        "P [deg]",
        "R [deg]",
    ]
    return save(folder / "a.csv", named(names, grid(J, P, angles("xyz")), ","))


@case("KUKA's A, B, C, measured", turned=True)
def euler_kuka(folder: Path) -> Path:
    names = [
        *(f"{n} [deg]" for n in AXES),
        *(f"{a} meas [mm]" for a in "XYZ"),
        *(f"{a} meas [deg]" for a in "ABC"),
    ]
    return save(folder / "a.csv", named(names, grid(J, P, angles("ZYX")), ","))


@case("A, B, C that are not KUKA's", refuses="orientations that miss")
def euler_not_kuka(folder: Path) -> Path:
    names = [
        *(f"J{k} [deg]" for k in range(1, 7)),
        *(f"{a} [mm]" for a in "XYZ"),
        *(f"{a} [deg]" for a in "ABC"),
    ]
    return save(folder / "a.csv", named(names, grid(J, P, angles("xyz")), ","))


@case("Two lines of names: a group over x, y, z", targets=2)
def names_in_two_lines(folder: Path) -> Path:
    over = "Pose" + ";" * 7 + "T1;;;T2;;"
    rows = [[str(i), *each] for i, each in enumerate(grid(J, TRUTH.points[:, :2].reshape(N, 6)))]
    return save(folder / "a.csv", [over, *named(["Nr", *HEAD, *HEAD[6:]], rows)])


@case("A station in the preamble, a row of words for a lost point; joints in another file", lost_rows=(5,))
def lost_in_list(folder: Path) -> Sequence[Path]:
    rows = [[f"Pose{i + 1}", *each] for i, each in enumerate(grid(P))]
    rows[5] = ["Pose6", "lost", "lost", "lost"]
    head = ["Station;1000.0;2000.0;1500.0", ""]
    return [joint_list(folder), save(folder / "p.csv", [*head, *named(["Name", *HEAD[6:]], rows)])]


@case("A quaternion with the scalar last, by name", turned=True)
def quaternion_last(folder: Path) -> Path:
    names = [*(f"J{k} [deg]" for k in range(1, 7)), *(f"{a} [mm]" for a in "XYZ"), "qx", "qy", "qz", "qw"]
    return save(folder / "a.csv", named(names, grid(J, P, Q[:, [1, 2, 3, 0]]), ","))


@case("q1 .. q4 without a word which is the scalar: the robot tells", turned=True)
def quaternion_numbered(folder: Path) -> Path:
    names = [*(f"J{k} [deg]" for k in range(1, 7)), *(f"{a} [mm]" for a in "XYZ"), "q1", "q2", "q3", "q4"]
    return save(folder / "a.csv", named(names, grid(J, P, Q), ","))


@case("Three targets side by side, one row a pose", targets=3)
def targets_wide(folder: Path) -> Path:
    names = [
        "Pose",
        *(f"J{k} [deg]" for k in range(1, 7)),
        *(f"T{t}_{a} [mm]" for t in (1, 2, 3) for a in "xyz"),
    ]
    rows = [[str(i), *each] for i, each in enumerate(grid(J, TRUTH.points.reshape(N, 9)))]
    return save(folder / "a.csv", named(names, rows))


@case("Three targets below each other, with their names", targets=3)
def targets_long(folder: Path) -> Path:
    names = [*(f"J{k} [deg]" for k in range(1, 7)), "Target", *(f"{a} [mm]" for a in "XYZ")]
    rows = [[*grid(J)[i], f"T{t + 1}", *grid(TRUTH.points[:, t])[i]] for i in range(N) for t in range(3)]
    return save(folder / "a.csv", named(names, rows))


def joint_list(folder: Path, name: str = "Pose{}", numbers: Sequence[int] = range(1, N + 1)) -> Path:
    rows = [[name.format(numbers[i]), *grid(J)[i]] for i in range(N)]
    return save(folder / "joints.csv", named(["Name", *(f"J{k} [deg]" for k in range(1, 7))], rows))


@case("Joints by pose; points of SpatialAnalyzer by name, in another order, three targets", targets=3)
def spatial_analyzer(folder: Path) -> Sequence[Path]:
    lines = ["// SpatialAnalyzer 2023.1", "// Frame: World, Units: Millimeters", "// Point Name, X, Y, Z"]
    lines += [
        f"A::Robot::Pose{i + 1}_T{t + 1}, {', '.join(grid(TRUTH.points[:, t])[i])}"
        for t in range(3)
        for i in reversed(range(N))
    ]
    return [joint_list(folder), save(folder / "points.txt", [*lines, "A::Nest::N1, 0.0, 0.0, 0.0"])]


@case(
    "Points with mere numbers for names: whether they count rows is asked",
    asks=("match",),
    answers={"match": "name"},
)
def numbers_as_names(folder: Path) -> Sequence[Path]:
    rows = [[str(i + 1), *grid(P)[i]] for i in reversed(range(N))]
    return [
        joint_list(folder, "{}"),
        save(folder / "leica.csv", named(["Point ID", "X [mm]", "Y [mm]", "Z [mm]"], rows, ",")),
    ]


@case("Points without names: by order only as told", asks=("match",), answers={"match": "order"})
def by_order(folder: Path) -> Sequence[Path]:
    return [joint_list(folder), save(folder / "p.txt", named(["X [mm]", "Y [mm]", "Z [mm]"], grid(P), "\t"))]


@case(
    "By order, and one point too many",
    answers={"match": "order"},
    asks=("match",),
    refuses="cannot belong together in order",
)
def by_order_too_many(folder: Path) -> Sequence[Path]:
    rows = [*grid(P), grid(P)[-1]]
    return [joint_list(folder), save(folder / "p.txt", named(["X [mm]", "Y [mm]", "Z [mm]"], rows, "\t"))]


@case("Joints and points by time", asks=("match",), answers={"match": "time", "within_s": "3"})
def by_time(folder: Path) -> Sequence[Path]:
    def stamp(seconds: float) -> str:
        return f"2025-03-12 {9 + int(seconds) // 3600:02d}:{int(seconds) // 60 % 60:02d}:{seconds % 60:06.3f}"

    one = named(
        ["Time", *(f"J{k} [deg]" for k in range(1, 7))], [[stamp(20.0 * i), *grid(J)[i]] for i in range(N)]
    )
    two = named(
        ["Timestamp", "X [mm]", "Y [mm]", "Z [mm]"], [[stamp(20.0 * i + 1.7), *grid(P)[i]] for i in range(N)]
    )
    return [save(folder / "robot.csv", one), save(folder / "tracker.csv", two)]


def book(path: Path, sheets: dict[str, Sequence[Sequence[Any]]], merge: Sequence[str] = ()) -> Path:
    out = openpyxl.Workbook()
    out.remove(out.worksheets[0])
    for name, rows in sheets.items():
        sheet = out.create_sheet(name)
        for row in rows:
            sheet.append([None if cell == "" else cell for cell in row])
        for area in merge:
            sheet.merge_cells(area)
    out.save(path)
    return path


@case("A workbook with a title, a preamble and a row of units")
def workbook(folder: Path) -> Path:
    rows = [["Calibration of robot 4"], [], ["Operator", "A. Smith"], [], [h.split()[0] for h in HEAD],
            [h.split()[1] for h in HEAD], *BODY]  # fmt: skip
    return book(folder / "a.xlsx", {"Data": rows, "Notes": [["nothing here"]]})


@case("A workbook with merged cells: targets over x, y, z, poses over rows", targets=2)
def workbook_merged(folder: Path) -> Path:
    rows: list[list[Any]] = [
        ["Pose", "Joints [deg]", *[""] * 5, "T1", "", "", "T2", "", ""],
        ["", *(f"J{k}" for k in range(1, 7)), *["X [mm]", "Y [mm]", "Z [mm]"] * 2],
    ]
    rows += [[i, *J[i].tolist(), *TRUTH.points[i, :2].ravel().tolist()] for i in range(N)]
    return book(folder / "a.xlsx", {"Data": rows}, ["B1:G1", "H1:J1", "K1:M1", "A1:A2"])


def formulas(path: Path, *, saved: bool) -> Path:
    """X as a formula, with the value that Excel would have saved, or without."""
    rows = [[*row[:6], f"={row[6]!r}*1", *row[7:]] for row in BODY]
    book(path, {"Data": [HEAD, *rows]})
    if saved:
        with zipfile.ZipFile(path) as packed:
            parts = {name: packed.read(name) for name in packed.namelist()}
        with zipfile.ZipFile(path, "w") as packed:
            for name, data in parts.items():
                if name.endswith("sheet1.xml"):
                    data = re.sub(rb"<f>([-\d.]+)\*1</f><v\s*/?>(?:</v>)?", rb"<f>\1*1</f><v>\1</v>", data)
                packed.writestr(name, data)
    return path


@case("A workbook of formulas whose values were saved")
def workbook_formulas(folder: Path) -> Path:
    return formulas(folder / "a.xlsx", saved=True)


@case("A workbook of formulas that were never computed", refuses="formula whose value was never computed")
def workbook_uncomputed(folder: Path) -> Path:
    return formulas(folder / "a.xlsx", saved=False)


@case("A workbook with joints on one sheet and points on another")
def workbook_two_parts(folder: Path) -> Path:
    joints = [["Name", *HEAD[:6]], *[[f"P{i}", *J[i].tolist()] for i in range(N)]]
    points = [["Name", *HEAD[6:]], *[[f"P{i}", *P[i].tolist()] for i in reversed(range(N))]]
    return book(folder / "a.xlsx", {"Robot": joints, "Tracker": points})


@case("A workbook with the same table on two sheets", asks=("sheet",), answers={"sheet": "after"})
def workbook_two_sheets(folder: Path) -> Path:
    before = [[*row[:6], *(v + 1.0 for v in row[6:])] for row in BODY]
    return book(folder / "a.xlsx", {"before": [HEAD, *before], "after": [HEAD, *BODY]})


@case("A workbook in which Excel made a date of a number", refuses="date")
def workbook_date(folder: Path) -> Path:
    import datetime

    rows: list[list[Any]] = [list(row) for row in BODY]
    rows[7][3] = datetime.datetime(2025, 5, 1)
    return book(folder / "a.xlsx", {"Data": [HEAD, *rows]})


@case("Two tables on one sheet", refuses="holds 2 tables")
def two_tables(folder: Path) -> Path:
    lines = named(HEAD, grid(J, P))
    return save(
        folder / "a.csv", ["before", *lines, "", "after", *[lines[0].replace("[mm]", "(mm)"), *lines[1:]]]
    )


@case(
    "X, Y, Z given twice, with other values: the robot cannot tell",
    asks=("points",),
    answers={"points": "X [mm]"},
)
def twice(folder: Path) -> Path:
    other = P + np.random.default_rng(1).normal(0.0, 0.2, P.shape)
    return save(folder / "a.csv", named([*HEAD, *HEAD[6:]], grid(J, P, other)))


@case("J1 .. J6 given twice, the same")
def twice_the_same(folder: Path) -> Path:
    return save(folder / "a.csv", named([*HEAD, *HEAD[:6]], grid(J, P, J)))


@case("Thousands in German: 1.234,567")
def thousands_german(folder: Path) -> Path:
    rows = [[*(num(v, 3, True, ".") for v in J[i]), *(num(v, 4, True, ".") for v in P[i])] for i in range(N)]
    return save(folder / "a.csv", named(HEAD, rows))


@case('Thousands in English, in quotes: "1,234.567"')
def thousands_english(folder: Path) -> Path:
    rows = [[*(f'"{v:,.4f}"' for v in (*J[i], *P[i]))] for i in range(N)]
    return save(folder / "a.csv", named([f'"{h}"' for h in HEAD], rows, ","))


@case(
    "Numbers that may be 1,234 or 1234: whole millimetres",
    asks=("decimal",),
    answers={"decimal": "."},
    within=0.51,
)
def thousands_unclear(folder: Path) -> Path:
    rows = [[*(f"{v:.0f}" for v in np.round(J[i])), *(f"{v:,.0f}" for v in P[i])] for i in range(N)]
    return save(folder / "a.csv", named(HEAD, rows, ";"))


@case("Commas for cells and for decimals", refuses="commas stand between the cells and in the numbers")
def commas_twice(folder: Path) -> Path:
    rows = [[num(v, 3, True) for v in (*J[i], *P[i])] for i in range(N)]
    return save(folder / "a.csv", named(HEAD, rows, ","))


@case("A spreadsheet made a date of a number in a CSV", refuses="made a date of a number")
def date_in_text(folder: Path) -> Path:
    rows = grid(J, P)
    rows[4][2] = "01. Mai"
    return save(folder / "a.csv", named(HEAD, rows))


@case("An empty cell among the joints", refuses=r"line 8.*is empty")
def empty_joint(folder: Path) -> Path:
    rows = grid(J, P)
    rows[6][1] = ""
    return save(folder / "a.csv", named(HEAD, rows))


@case("Means below the table, a remark, a line between the readings")
def means_below(folder: Path) -> Path:
    lines = named(["Nr", *HEAD], [[str(i + 1), *each] for i, each in enumerate(grid(J, P))])
    mean = ";".join(["Mittelwert", *(f"{v:.3f}" for v in (*J.mean(axis=0), *P.mean(axis=0)))])
    lines.insert(9, "Pause von 20 min")
    return save(folder / "a.csv", [*lines, "", mean, "Ende der Messung"])


@case("Points that were lost: --- in the cells", lost=(LEFT_OUT, 11))
def lost(folder: Path) -> Path:
    rows = grid(J, P)
    for i in (LEFT_OUT, 11):
        rows[i][6:] = ["---"] * 3
    return save(folder / "a.csv", named(HEAD, rows))


@case("A column of status in German: i.O. and n.i.O.", rejected=(LEFT_OUT,))
def status(folder: Path) -> Path:
    rows = [[*each, "n.i.O." if i == LEFT_OUT else "i.O."] for i, each in enumerate(grid(J, P))]
    return save(folder / "a.csv", named([*HEAD, "Status"], rows))


@case("Commanded and read joints, the robot's own TCP, speeds and torques")
def logger(folder: Path) -> Path:
    names = ["t [s]", *(f"J{k} cmd [deg]" for k in range(1, 7)), *(f"J{k} act [deg]" for k in range(1, 7)),
             "TCP X [mm]", "TCP Y [mm]", "TCP Z [mm]", "Speed [mm/s]", *(f"LT {a} [mm]" for a in "XYZ")]  # fmt: skip
    rows = grid(np.arange(N) * 12.5, J, J + 0.002, OWN, np.zeros(N), P)
    return save(folder / "log.csv", named(names, rows, ","))


@case("Only what the controller shows: no instrument measured it", asks=("points",), answers={"points": "TCP X [mm]"},
      refuses="controller's own")  # fmt: skip
def own_numbers(folder: Path) -> Path:
    names = [*HEAD[:6], "TCP X [mm]", "TCP Y [mm]", "TCP Z [mm]"]
    return save(folder / "a.csv", named(names, grid(J, OWN)))


@case("Only points: the joints are missing", refuses="no file holds joint angles")
def only_points(folder: Path) -> Path:
    return save(
        folder / "a.csv", named(["Name", *HEAD[6:]], [[f"P{i}", *each] for i, each in enumerate(grid(P))])
    )


@case("Joints by pose; points one coordinate a line (as reports of inspection programs)", within=1e-3)
def tall(folder: Path) -> Sequence[Path]:
    rows = [
        [
            f"Pose{i + 1}" if k == 0 else "",
            "XYZ"[k],
            f"{OWN[i, k]:.3f}",
            f"{P[i, k]:.4f}",
            f"{P[i, k] - OWN[i, k]:.3f}",
        ]
        for i in range(N)
        for k in range(3)
    ]
    head = ["PolyWorks|Inspector", "Project: cell 4", "Units: Millimeters", ""]
    return [
        joint_list(folder),
        save(folder / "a.txt", [*head, *named(["Name", "Control", "Nom", "Meas", "Dev"], rows, "\t")]),
    ]


def outcome(of: Case) -> str:
    """What becomes of a case, as `docs/howto/exports.md` has it."""
    if of.refuses and not of.asks:
        return "refused"
    asked = f"asked: {', '.join(f'`{key}`' for key in of.asks)}" if of.asks else ""
    return f"{asked}, then {'refused' if of.refuses else 'read'}" if asked else "read"
