"""Import of a robot file from a table of DH parameters, as makers, papers and spreadsheets print them.

Columns are found by the usual words, in any order; angles may be in deg or rad (`pi/2` too), lengths in mm or m. A unit
that neither the header nor the numbers show is asked for; assumptions are reported.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from calib.arm import Robot
from calib.arm.robot import Convention
from calib.errors import DataError
from calib.robot_file.dh_words import ANGLES, LENGTHS, LIMITS, Cell, cell, heading
from calib.robot_file.draft import Draft, DraftLink, written_robot
from calib.text import read_text, rows_of
from calib.units import DEG

Angles = Literal["deg", "rad"]
Lengths = Literal["mm", "m"]
MOST_BYTES = 1024 * 1024
MOST_ROWS = 20
_SLIDES = ("p", "prismatic", "slides", "slide", "linear", "1")
_TURNS = ("", "r", "revolute", "turns", "turn", "rotary", "0")
_FULL_TURN = 360.0
_LARGEST_RAD = 6.4  # a full turn and a rounding
_LONGEST_M, _SHORTEST_MM = 8.0, 20.0  # between them the longest link of an arm may be in either unit


@dataclass(frozen=True)
class Table:
    """The cells of a table by meaning, each with its line; the units that its header names ("" where it names none)."""

    path: Path
    lines: tuple[int, ...]
    cells: dict[str, tuple[Cell, ...]]
    slides: tuple[bool, ...]
    units: dict[str, str]


def import_dh(
    path: Path,
    convention: Convention,
    *,
    angles: Angles | None = None,
    lengths: Lengths | None = None,
    name: str | None = None,
    maker: str = "unknown",
) -> tuple[Draft, Robot, tuple[str, ...]]:
    """The robot file of a table, its robot, and what was taken for granted. Raises DataError naming the line."""
    table = read_table(path)
    angle, how_angle = _unit_of_angles(table, angles)
    length, how_length = _unit_of_lengths(table, lengths)
    remarks = [f"Angles were read as {angle}: {how_angle}. Lengths as {length}: {how_length}."]
    links = tuple(_link(table, k, angle, length) for k in range(len(table.lines)))
    if "min" not in table.cells:
        remarks.append(
            "The table has no limits: -360 to 360 deg were written; correct them by the data sheet."
        )
    draft = Draft(
        name=name or path.stem,
        maker=maker,
        convention=convention,
        source=f"table {path.name}, read as {convention}",
        links=links,
        remarks=("Written by 'truepose robot import'. docs/robot-file.md explains every key.", *remarks),
    )
    return draft, written_robot(draft), tuple(remarks)


def read_table(path: Path) -> Table:
    """The DH numbers of a file. Raises DataError where columns are not found, or a cell holds no number."""
    text = read_text(path, MOST_BYTES)
    rows = [
        (line, cells)
        for line, cells in rows_of(text, path, _delimiter(text))
        if any(c.strip() for c in cells)
    ]
    start = next(
        (i for i, (_, cells) in enumerate(rows) if _meanings(cells).keys() >= {"alpha", "a", "d"}), None
    )
    if start is None:
        raise DataError(
            "has no row of headings with alpha, a and d (and theta).",
            do="Name the columns, for instance: link;alpha_deg;a_mm;theta_deg;d_mm;min_deg;max_deg.",
            file=path,
        )
    head_line, head = rows[start]
    meanings, body = _meanings(head), rows[start + 1 :]
    named = [heading(text).meaning for text in head]
    for meaning in meanings:
        if named.count(meaning) > 1 and meaning not in ("link", "kind"):
            raise DataError(
                f"has {named.count(meaning)} columns that mean {meaning}.",
                do="Keep one, or name the others otherwise.",
                file=path,
                line=head_line,
            )
    if ("min" in meanings) != ("max" in meanings):
        raise DataError("has one limit without the other.", do="Give min and max.", file=path, line=head_line)
    if not 1 <= len(body) <= MOST_ROWS:
        raise DataError(f"has {len(body)} rows of links.", do=f"Give 1 to {MOST_ROWS}.", file=path)
    cells = {
        meaning: tuple(_cell(path, line, row, at, meaning) for line, row in body)
        for meaning, at in meanings.items()
        if meaning in (*ANGLES, *LENGTHS, *LIMITS)
    }
    cells.setdefault("theta", (Cell(0.0),) * len(body))
    slides = tuple(
        _slides(path, line, row, meanings.get("kind")) or cells["d"][i].variable
        for i, (line, row) in enumerate(body)
    )
    units = {meaning: heading(head[at]).unit for meaning, at in meanings.items()}
    return Table(path, tuple(line for line, _ in body), cells, slides, units)


def _delimiter(text: str) -> str:
    """The sign that splits most lines; a comma only where no other does, since it may be a decimal one."""
    lines = [line for line in text.splitlines() if line.strip()]
    return next(
        (sign for sign in ("\t", ";", "|") if sum(sign in line for line in lines) > len(lines) / 2), ","
    )


def _meanings(head: Sequence[str]) -> dict[str, int]:
    found: dict[str, int] = {}
    for at, text in enumerate(head):
        if (meaning := heading(text).meaning) is not None:
            found.setdefault(meaning, at)
    return found


def _cell(path: Path, line: int, row: Sequence[str], at: int, meaning: str) -> Cell:
    text = row[at] if at < len(row) else ""
    found = cell(text)
    if found is None:
        raise DataError(
            f"{meaning} is {text.strip()!r}.",
            do="Give a number, a multiple of pi, or q1 + a number; a joint that counts the other way belongs in a "
            "joint matrix.",
            file=path,
            line=line,
        )
    return found


def _slides(path: Path, line: int, row: Sequence[str], at: int | None) -> bool:
    word = "" if at is None or at >= len(row) else row[at].strip().lower()
    if word not in (*_SLIDES, *_TURNS):
        raise DataError(f"the joint is {word!r}.", do="Write turns or slides.", file=path, line=line)
    return word in _SLIDES


def _given(table: Table, meanings: Sequence[str], wanted: Sequence[str]) -> str:
    """The unit that the header names for some columns; "" where it names none. Raises DataError for two."""
    units = {table.units.get(meaning, "") for meaning in meanings} & set(wanted)
    if len(units) > 1:
        raise DataError(
            f"names {' and '.join(sorted(units))} for {' and '.join(meanings)}.",
            do="Use one unit for all.",
            file=table.path,
        )
    return next(iter(units), "")


def _numbers(table: Table, meanings: Sequence[str]) -> np.ndarray:
    return np.array([cell.value for meaning in meanings for cell in table.cells[meaning]])


def _unit_of_angles(table: Table, asked: Angles | None) -> tuple[str, str]:
    of_pi = any(each.pi for meaning in ANGLES for each in table.cells[meaning])
    named = _given(table, ANGLES, ("deg", "rad"))
    if of_pi and "deg" in (asked, named):
        raise DataError("says degrees, but holds pi.", do="Use one of the two.", file=table.path)
    if asked or named:
        return asked or named, "as asked for" if asked else "as the header has it"
    values = np.abs(_numbers(table, ANGLES))
    largest = float(values.max())
    if of_pi:
        return "rad", "pi stands in it"
    if largest > _LARGEST_RAD:
        return "deg", f"the largest is {largest:g}"
    turned = values[values > 0.0]
    if len(turned) and np.all(np.abs(turned / (DEG * 45.0) - np.round(turned / (DEG * 45.0))) < 2e-3):
        return "rad", "they are multiples of pi/4"
    if not len(turned):
        return "deg", "all are 0"
    raise DataError(
        f"does not show whether its angles are deg or rad (the largest is {largest:g}).",
        do="Say --angles deg or --angles rad.",
        file=table.path,
    )


def _unit_of_lengths(table: Table, asked: Lengths | None) -> tuple[str, str]:
    named = _given(table, LENGTHS, ("mm", "m"))
    if asked or named:
        return asked or named, "as asked for" if asked else "as the header has it"
    largest = float(np.abs(_numbers(table, LENGTHS)).max())
    if largest == 0.0:
        return "mm", "all are 0"
    if largest <= _LONGEST_M:
        return "m", f"the largest is {largest:g}"
    if largest >= _SHORTEST_MM:
        return "mm", f"the largest is {largest:g}"
    raise DataError(
        f"does not show whether its lengths are mm or m (the largest is {largest:g}).",
        do="Say --lengths mm or --lengths m.",
        file=table.path,
    )


def _link(table: Table, k: int, angle: str, length: str) -> DraftLink:
    turn, span = (1.0 / DEG if angle == "rad" else 1.0), (1000.0 if length == "m" else 1.0)
    slides = table.slides[k]
    low, high = _limits(table, k, turn, span)
    return DraftLink(
        turn * table.cells["alpha"][k].value,
        span * table.cells["a"][k].value,
        turn * table.cells["theta"][k].value,
        span * table.cells["d"][k].value,
        low,
        high,
        slides,
    )


def _limits(table: Table, k: int, turn: float, span: float) -> tuple[float, float]:
    if "min" not in table.cells:
        if table.slides[k]:
            raise DataError(
                "slides, and the table has no limits.",
                do="Add the columns min and max.",
                file=table.path,
                line=table.lines[k],
            )
        return -_FULL_TURN, _FULL_TURN
    unit = {table.units.get("min", ""), table.units.get("max", "")} - {""}
    low, high = (table.cells[meaning][k].value for meaning in LIMITS)
    if table.slides[k]:
        factor = {"mm": 1.0, "m": 1000.0}.get(next(iter(unit), ""), span)
    else:
        factor = {"deg": 1.0, "rad": 1.0 / DEG}.get(next(iter(unit), ""), turn)
    if low > high:
        raise DataError(
            f"has its limits swapped: {low:g} to {high:g}.",
            do="Exchange the two.",
            file=table.path,
            line=table.lines[k],
        )
    return round(factor * low, 4), round(factor * high, 4)
