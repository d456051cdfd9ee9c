"""Import of robot files from DH tables, as makers, papers and spreadsheets print them.

Columns are found by the usual words, in any order. Angles may be in deg or rad (`pi/2` too), lengths in
mm or m. The user must give a unit that neither the header nor the numbers show. Assumptions and columns
that are left out are reported.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import numpy as np

from calib.arm import Robot
from calib.arm.robot import Convention
from calib.errors import DataError
from calib.robot_file.dh_words import ANGLES, LENGTHS, LIMITS, DhCell, cell, ends, heading
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
_MOST_TURN = 25.0  # rad: four turns; a limit beyond is one in degrees
_LONGEST_ARM_MM = 10_000.0  # all lengths together; the largest arms reach 4.7 m
_SHORTEST_ARM_MM = 50.0
_LONGEST_TRACK_MM = 100_000.0
_SIGNS = {"1": 1.0, "+1": 1.0, "+": 1.0, "1.0": 1.0, "-1": -1.0, "-": -1.0, "-1.0": -1.0}
_DH = r"(?=.*(?:\bdh\b|denavit|convention))"
_MODIFIED = re.compile(rf"{_DH}.*\b(?:modified|proximal)\b|.*\b(?:mdh|craig|khalil)\b", re.IGNORECASE)
_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2}(?:,\d{3})+")
_NO_JOINTS = (
    "base",
    "world",
    "ground",
    "tool",
    "tcp",
    "flange",
    "ee",
    "eef",
    "end effector",
    "gripper",
    "hand",
)
_STANDARD = re.compile(rf"{_DH}.*\b(?:standard|classic(?:al)?|distal)\b|\s*s?dh\s*$", re.IGNORECASE)


@dataclass(frozen=True)
class DhTable:
    """Cells of a DH table by meaning, each with its line.

    Attributes
    ----------
    units : dict of str to str
        Units that the header names, by meaning; "" if it names none.
    signs : tuple of float
        1.0 or -1.0 for each joint, as its controller counts.
    aside : tuple of str
        Headings of columns that are not read.
    shows : dict
        Conventions that the words of the table show, each with these words.
    empty : dict of str to list of int
        Lines without a number, by meaning.
    """

    path: Path
    lines: tuple[int, ...]
    cells: dict[str, tuple[DhCell, ...]]
    slides: tuple[bool, ...]
    units: dict[str, str]
    signs: tuple[float, ...]
    aside: tuple[str, ...]
    shows: dict[Convention, str]
    empty: dict[str, list[int]]


def import_dh(
    path: Path,
    convention: Convention | None = None,
    *,
    angles: Angles | None = None,
    lengths: Lengths | None = None,
    limits: Angles | None = None,
    name: str | None = None,
    maker: str = "unknown",
) -> tuple[Draft, Robot, tuple[str, ...]]:
    """Import a robot file from a DH table.

    Parameters
    ----------
    path : Path
        File of the table.
    convention : str, optional
        "mdh" or "dh"; None if the table shows it.
    angles, lengths, limits : str, optional
        Units, if the table does not show them. `lengths` and `limits` also permit numbers that no arm has.
    name, maker : str, optional
        Name and maker of the robot.

    Returns
    -------
    tuple
        Draft of the robot file, its robot, and the assumptions made.

    Raises
    ------
    DataError
        The table cannot be read, or its convention or a unit is unknown; the error names the line.
    """
    table = read_table(path)
    asked, convention = convention, _convention(table, convention)
    angle, how_angle = _unit_of_angles(table, angles)
    length, how_length = _unit_of_lengths(table, lengths)
    remarks = [f"Angles were read as {angle}: {how_angle}. Lengths as {length}: {how_length}."]
    if asked is None:
        remarks.append(f"The convention was read as {convention}: '{table.shows[convention][:60]}' shows it.")
    remarks += [
        f"Empty cells were read as {meaning} = 0 (lines {', '.join(map(str, lines))})."
        for meaning, lines in table.empty.items()
        if lines
    ]
    limit, how_limit = _unit_of_limits(table, limits, angle)
    if how_limit:
        remarks.append(f"Limits were read as {limit}: {how_limit}.")
    rounded: dict[str, float] = {}
    links = tuple(_link(table, k, (angle, length, limit), rounded) for k in range(len(table.lines)))
    if lengths is None:
        _refuse_other_lengths(table, links)
    remarks += [f"{text} was taken as {value:g} deg exactly." for text, value in rounded.items()]
    remarks += [f"Column '{name}' was left aside: a robot file has nothing for it." for name in table.aside]
    matrices = {}
    if min(table.signs) < 0.0:
        matrices["direction"] = (np.diag(table.signs), np.zeros(len(links)))
        counted = ", ".join(str(k) for k, sign in enumerate(table.signs, start=1) if sign < 0.0)
        remarks.append(
            f"Joints {counted} count the other way: they are in the joint matrix 'direction'. Set joint_coupling = "
            '"direction" in the header of your data and in the cell file.'
        )
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
        matrices=matrices,
        remarks=("Written by 'truepose robot import'. docs/robot-file.md explains every key.", *remarks),
    )
    return draft, written_robot(draft), tuple(remarks)


def read_table(path: Path) -> DhTable:
    """Read the DH numbers of a file.

    Raises
    ------
    DataError
        Columns are not found, or a cell holds no number.
    """
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
    read = {at for meaning, at in meanings.items() if meaning != "range" or "min" not in meanings}
    aside = [
        text.strip() or f"number {at + 1}"
        for at, text in enumerate(head)
        if at not in read and named[at] not in ("link", "kind")
        # A line may be filled up with signs that separate nothing
        if text.strip() or any(at < len(row) and row[at].strip() for _, row in body)
    ]
    if ("min" in meanings) != ("max" in meanings):
        raise DataError("has one limit without the other.", do="Give min and max.", file=path, line=head_line)
    if not 1 <= len(body) <= MOST_ROWS:
        raise DataError(f"has {len(body)} rows of links.", do=f"Give 1 to {MOST_ROWS}.", file=path)
    cells = {
        meaning: tuple(_cell(path, line, row, at, meaning) for line, row in body)
        for meaning, at in meanings.items()
        if meaning in (*ANGLES, *LENGTHS, *LIMITS)
    }
    for line, row in body:
        if not any(
            row[at].strip() for m, at in meanings.items() if m in (*ANGLES, *LENGTHS) and at < len(row)
        ):
            raise DataError("holds no numbers of a link.", do="Take it out.", file=path, line=line)
    for (line, row), at in ((each, meanings["beta"]) for each in body if "beta" in meanings):
        if _cell(path, line, row, at, "beta").value != 0.0:
            raise DataError(
                "has a beta (Hayati), but a robot file describes the nominal arm, which has none.",
                do="Give the maker's own numbers. The errors of one arm belong into a model (truepose identify).",
                file=path,
                line=line,
            )
    _refuse_other_rows(path, body, meanings.get("link"))
    _refuse_thousands(path, body, [at for m, at in meanings.items() if m in (*ANGLES, *LENGTHS, *LIMITS)])
    empty = {
        meaning: [line for line, row in body if at >= len(row) or not row[at].strip()]
        for meaning, at in meanings.items()
        if meaning in (*ANGLES, *LENGTHS)
    }
    units = {meaning: heading(head[at]).unit for meaning, at in meanings.items()}
    if "range" in meanings and "min" not in meanings:
        both = [_ends(path, line, row, meanings["range"]) for line, row in body]
        cells["min"], cells["max"] = (tuple(pair[i] for pair in both) for i in range(2))
        units["min"] = units["max"] = units["range"]
    cells.setdefault("theta", (DhCell(0.0),) * len(body))
    signs = tuple(_sign(path, line, row, meanings.get("sign")) for line, row in body)
    slides = tuple(
        _slides(path, line, row, meanings.get("kind")) or cells["d"][i].variable
        for i, (line, row) in enumerate(body)
    )
    lines = tuple(line for line, _ in body)
    return DhTable(path, lines, cells, slides, units, signs, tuple(aside), _shown(rows, head), empty)


def _refuse_other_rows(path: Path, body: Sequence[tuple[int, Sequence[str]]], at: int | None) -> None:
    """Raise DataError for rows that are not numbered in order, or whose name is not a joint's."""
    before: int | None = None
    if at is None:
        return
    for line, row in body:
        name = row[at].strip().lower() if at < len(row) else ""
        number = re.fullmatch(r"\D{0,12}(\d{1,3})", name)
        if name in _NO_JOINTS:
            do = "Take the row out: it is no joint. What stands behind the last joint belongs to the tool targets."
            raise DataError(f"is the row of '{name}'.", do=do, file=path, line=line)
        if number is not None and before is not None and int(number[1]) != before + 1:
            do = "Order the rows from the base to the flange, and number them so."
            raise DataError(f"row {number[1]} follows row {before}.", do=do, file=path, line=line)
        before = None if number is None else int(number[1])


def _refuse_thousands(path: Path, body: Sequence[tuple[int, Sequence[str]]], columns: Sequence[int]) -> None:
    """Raise DataError for a comma that may separate thousands, if no other is a decimal one."""
    cells = [(line, row[at].strip()) for line, row in body for at in columns if at < len(row)]
    commas = [(line, text) for line, text in cells if "," in text]
    odd = [(line, text) for line, text in commas if _THOUSANDS.fullmatch(text)]
    if odd and (len(odd) == len(commas) or any("." in text for _, text in cells)):
        line, text = odd[0]
        plain, point = text.replace(",", ""), text.replace(",", ".")
        do = f"Write {plain}, or {point} with a decimal point."
        raise DataError(f"'{text}' may be {plain} or {point}.", do=do, file=path, line=line)


def _shown(rows: Sequence[tuple[int, Sequence[str]]], head: Sequence[str]) -> dict[Convention, str]:
    """Find conventions that the words of a table show, each with these words."""
    shows: dict[Convention, str] = {}
    for _, row in rows:
        for text in row:
            if _MODIFIED.match(text):
                shows["mdh"] = text.strip()
            elif _STANDARD.match(text):
                shows["dh"] = text.strip()
    for text in head:
        if heading(text).before and heading(text).meaning in ("alpha", "a"):
            shows["mdh"] = text.strip()
    return shows


def _convention(table: DhTable, asked: Convention | None) -> Convention:
    """Return the requested convention, or the one that the table shows.

    Raises
    ------
    DataError
        The two differ, or there is none.
    """
    for shown, words in table.shows.items():
        if asked not in (None, shown) or len(table.shows) > 1:
            raise DataError(
                f"is headed '{words[:60]}', which is {shown}"
                + (f", not {asked}." if asked not in (None, shown) else "; it names the other one too."),
                do=f"Say --convention {shown}, or correct the words in the table if they are wrong.",
                file=table.path,
                key="--convention",
            )
        return shown
    if asked is None:
        raise DataError(
            "is not given: the same numbers describe a different arm in each convention.",
            do="Say --convention dh (standard: alpha and a lead to the next axis) or mdh (modified, Craig).",
            key="--convention",
        )
    return asked


def _delimiter(text: str) -> str:
    """Find the sign that splits most lines.

    A comma is used only if no other sign does, since it may be a decimal one.
    """
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


def _cell(path: Path, line: int, row: Sequence[str], at: int, meaning: str) -> DhCell:
    text = row[at] if at < len(row) else ""
    found = cell(text)
    if found is None:
        raise DataError(
            f"{meaning} is {text.strip()!r}.",
            do="Give a number, a multiple of pi, or q1 + a number; a joint that counts the other way gets -1 in a "
            "column 'direction'.",
            file=path,
            line=line,
        )
    return found


def _slides(path: Path, line: int, row: Sequence[str], at: int | None) -> bool:
    word = "" if at is None or at >= len(row) else row[at].strip().lower()
    if word not in (*_SLIDES, *_TURNS):
        raise DataError(f"the joint is {word!r}.", do="Write turns or slides.", file=path, line=line)
    return word in _SLIDES


def _sign(path: Path, line: int, row: Sequence[str], at: int | None) -> float:
    word = "1" if at is None or at >= len(row) else row[at].strip().replace("−", "-")
    if word not in _SIGNS:
        raise DataError(f"the direction is {word!r}.", do="Write 1 or -1.", file=path, line=line)
    return _SIGNS[word]


def _ends(path: Path, line: int, row: Sequence[str], at: int) -> tuple[DhCell, DhCell]:
    text = row[at] if at < len(row) else ""
    found = ends(text)
    if found is None:
        raise DataError(
            f"the range is {text.strip()!r}.",
            do="Write both ends, as -165 to 165 or ±165, or columns min and max.",
            file=path,
            line=line,
        )
    return found


def _given(table: DhTable, meanings: Sequence[str], wanted: Sequence[str]) -> str:
    """Return the unit that the header names for some columns; "" if it names none.

    Raises
    ------
    DataError
        The header names two units.
    """
    units = {table.units.get(meaning, "") for meaning in meanings} & set(wanted)
    if len(units) > 1:
        raise DataError(
            f"names {' and '.join(sorted(units))} for {' and '.join(meanings)}.",
            do="Use one unit for all.",
            file=table.path,
        )
    return next(iter(units), "")


def _numbers(table: DhTable, meanings: Sequence[str]) -> np.ndarray:
    return np.array([cell.value for meaning in meanings for cell in table.cells[meaning]])


def _unit_of_angles(table: DhTable, asked: Angles | None) -> tuple[str, str]:
    of_pi = any(each.pi for meaning in ANGLES for each in table.cells[meaning])
    named = _given(table, ANGLES, ("deg", "rad"))
    if of_pi and "deg" in (asked, named):
        raise DataError("says degrees, but holds pi.", do="Use one of the two.", file=table.path)
    values = np.abs(_numbers(table, ANGLES))
    largest = float(values.max())
    if asked:
        return asked, "as asked for"
    if named and largest > 0.0 and not of_pi and (named == "deg") == (largest <= _LARGEST_RAD):
        other = "rad" if named == "deg" else "deg"
        raise DataError(
            f"names {named} for its angles, of which the largest is {largest:g}.",
            do=f"If they are {other}, say --angles {other}; if they are right, --angles {named}.",
            file=table.path,
            key="--angles",
        )
    if named:
        return named, "as the header has it"
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


def _unit_of_lengths(table: DhTable, asked: Lengths | None) -> tuple[str, str]:
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


def _unit_of_limits(table: DhTable, asked: Angles | None, angle: str) -> tuple[str, str]:
    """Find the unit of the limits of joints that turn.

    Also returns why it is not that of the angles.

    Raises
    ------
    DataError
        The numbers contradict the unit of the table.
    """
    cells = [
        table.cells[meaning][k]
        for meaning in LIMITS
        if meaning in table.cells
        for k, slides in enumerate(table.slides)
        if not slides
    ]
    if asked or not cells:
        return asked or angle, "as asked for" if asked else ""
    named = _given(table, LIMITS, ("deg", "rad"))
    of_pi = any(each.pi for each in cells)
    largest = max(abs(each.value) for each in cells)
    told = named or ("rad" if of_pi else angle)
    fits = "deg" if largest > _MOST_TURN else "rad" if of_pi or 0.0 < largest <= _LARGEST_RAD else told
    if fits == "deg" and not named and not of_pi:
        return "deg", "" if angle == "deg" else f"the largest is {largest:g}"
    if fits != told:
        raise DataError(
            f"has limits in {told}, as it seems, of which the largest is {largest:g}.",
            do=f"If they are {fits}, say --limits {fits}; if they are right, --limits {told}.",
            file=table.path,
            key="--limits",
        )
    return told, "" if told == angle else "as the table shows"


def _refuse_other_lengths(table: DhTable, links: Sequence[DraftLink]) -> None:
    """Raise DataError for an arm that is larger or smaller than any.

    Its lengths have another unit, or a digit too many.
    """
    spans = [abs(link.a_mm) + abs(link.d_mm) for link in links]
    tracks = [max(abs(link.low), abs(link.high)) for link in links if link.slides]
    arm = sum(spans)
    if (
        arm > _LONGEST_ARM_MM
        or 0.0 < arm + sum(tracks) < _SHORTEST_ARM_MM
        or max(tracks, default=0.0) > _LONGEST_TRACK_MM
    ):
        k = int(np.argmax(spans))
        raise DataError(
            f"is an arm whose lengths make {arm:g} mm together; the longest link has {spans[k]:g} mm.",
            do="Correct it, or state the unit with --lengths mm or --lengths m.",
            file=table.path,
            line=table.lines[k],
        )


def _link(table: DhTable, k: int, units: tuple[str, str, str], rounded: dict[str, float]) -> DraftLink:
    """Convert a row to a link of the draft.

    `units` are those of angles, lengths and limits. Angles that were read as multiples of 45 deg are
    added to `rounded`.
    """
    angle, length, limit = units
    turn, span = (1.0 / DEG if angle == "rad" else 1.0), (1000.0 if length == "m" else 1.0)
    slides = table.slides[k]
    low, high = _limits(table, k, 1.0 / DEG if limit == "rad" else 1.0, span)
    return DraftLink(
        turn * table.cells["alpha"][k].meant(angle, rounded),
        span * table.cells["a"][k].value,
        turn * table.cells["theta"][k].meant(angle, rounded),
        span * table.cells["d"][k].value,
        low,
        high,
        slides,
    )


def _limits(table: DhTable, k: int, turn: float, span: float) -> tuple[float, float]:
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
    factor = {"mm": 1.0, "m": 1000.0}.get(next(iter(unit), ""), span) if table.slides[k] else turn
    if low >= high:
        raise DataError(
            f"has its limits swapped: {low:g} to {high:g}." if low > high else f"has both limits at {low:g}.",
            do="Exchange the two." if low > high else "Give its limits from the data sheet.",
            file=table.path,
            line=table.lines[k],
        )
    return round(factor * low, 4), round(factor * high, 4)
