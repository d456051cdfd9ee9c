"""Exports as workbooks, with common additions: means, notes, lost rows, other numbers."""

from __future__ import annotations

import re
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import openpyxl

from calib.units import DEG
from tests.calib.exports.case import (
    BODY,
    HEAD,
    LEFT_OUT,
    OWN,
    TRUTH,
    J,
    N,
    P,
    case,
    grid,
    named,
    num,
    save,
)
from tests.calib.exports.texts import joint_list


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


@case("A workbook with cells in brackets: j:{2.63, ..}")
def workbook_brackets(folder: Path) -> Path:
    rows = [[i, f"j:{{{', '.join(grid(J)[i])}}}", f"[{', '.join(grid(P)[i])}]"] for i in range(N)]
    return book(folder / "a.xlsx", {"Data": [["Nr", "joints", "tracker"], *rows]})


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
    "X, Y, Z given twice, with other values: the robot cannot decide",
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


@case("Points that were lost: 0, 0, 0", asks=("origin",), answers={"origin": "lost"}, lost=(LEFT_OUT, 11))
def lost_as_zeros(folder: Path) -> Path:
    rows = grid(J, P)
    for i in (LEFT_OUT, 11):
        rows[i][6:] = ["0.000"] * 3
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


@case(
    "Joints read back that differ from the commanded ones by 0.27 deg",
    asks=("joints.read",),
    answers={"joints.read": "commanded"},
)
def read_elsewhere(folder: Path) -> Path:
    names = [
        *(f"J{k} cmd [deg]" for k in range(1, 7)),
        *(f"q_actual_{k} [rad]" for k in range(1, 7)),
        *HEAD[6:],
    ]
    off = np.where(np.arange(N)[:, None] % 2, 0.27, 0.0) * np.eye(6)[0]
    return save(folder / "a.csv", named(names, grid(J, (J + off) * DEG, P, decimals=9), ","))


@case("Only joints that the controller read back", asks=("joints.read",), answers={"joints.read": "read"})
def only_read(folder: Path) -> Path:
    names = [*(f"Achse {k} Ist [°]" for k in range(1, 7)), *HEAD[6:]]
    return save(folder / "a.csv", named(names, grid(J, P)))


@case("Only what the controller shows: no instrument measured it", asks=("points",), answers={"points": "TCP X [mm]"},
      refuses="computed by the controller")  # fmt: skip
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
