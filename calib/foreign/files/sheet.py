"""A sheet: the rows of cells of a file with their line numbers, before they are interpreted.

Text in any usual encoding, its cells apart by tabs, semicolons, commas, bars or blanks; or one sheet of a workbook
(`calib.foreign.files.workbook`).
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from calib.errors import DataError
from calib.foreign.files.labelled import Labelled, labelled
from calib.foreign.files.number import is_number
from calib.text.columns import refuse_wide, rows_of, taken
from calib.text.parquet import parquet_cells
from calib.text.text_file import decoded, read_bytes

SEPARATORS = {"tab": "\t", "semicolon": ";", "comma": ",", "bar": "|", "blanks": " "}
_COMMENT = re.compile(r"\s*(?://+|#+|%+)\s*(?=[^\s;,|])")
_REMARK = re.compile(r"(?:(?<=[\s;,|])|(?<=\d))//.*$")  # behind the cells, as SpatialAnalyzer writes it
_BLANKS = re.compile(r'"[^"]*"|\S+')
_WIDE = re.compile(r"\t+| {2,}")
MOST_BYTES = 64 * 1024 * 1024
TAKEN_APART = "cells carry labels or brackets: taken apart"
_LOOKED_AT = 400  # lines that tell how cells are set apart
FEWEST_NUMBERS = 3
"""Numbers in a row that make it one of a table."""


@dataclass(frozen=True)
class SheetRow:
    """A row of a sheet: its line in the file (from 1), its cells, and whether it is a comment."""

    line: int
    cells: tuple[str, ...]
    comment: bool = False


@dataclass(frozen=True)
class Sheet:
    """Rows of a file, or of one sheet of a workbook, without empty ones.

    Attributes
    ----------
    separator : str
        A name of `SEPARATORS`, '' in a workbook.
    said : tuple of str
        Remarks on how the file was read.
    groups : mapping of (int, int) to str
        By line and column of the empty rest of a cell merged in one row: the content of its first cell.
    spoilt : mapping of (int, int) to str
        By line and column of a cell that looks empty or odd: the reason why it holds no value.
    """

    path: Path
    name: str
    rows: tuple[SheetRow, ...]
    separator: str = ""
    said: tuple[str, ...] = ()
    groups: Mapping[tuple[int, int], str] = field(default_factory=dict)
    spoilt: Mapping[tuple[int, int], str] = field(default_factory=dict)

    @property
    def shown(self) -> str:
        """The file, and the sheet where there are several."""
        return f"{self.path}, sheet '{self.name}'" if self.name else str(self.path)


def text_sheet(path: Path, separator: str | None = None) -> Sheet:
    """Read the sheet of a text file.

    Raises
    ------
    DataError
        The file is no text; the error names file and line.
    """
    text, said = _text(path)
    lines = list(taken(text.split("\n"), path, "Check whether it is a table."))
    if lines and (match := re.fullmatch(r"sep=(.)", lines[0].strip())):  # a line for Excel
        lines[0] = ""
        separator = next((name for name, mark in SEPARATORS.items() if mark == match[1]), separator)
    if separator is None and (found := labelled([_REMARK.sub("", line) for line in lines])) is not None:
        return Sheet(
            path,
            "",
            _of_labels(lines, found, path),
            "",
            (*said, TAKEN_APART),
        )
    best = separator or _separator("\n".join(lines[:_LOOKED_AT]), path)
    return Sheet(path, "", tuple(_rows("\n".join(lines), path, best)), best, said)


def parquet_sheet(path: Path) -> Sheet:
    """Read a Parquet file as a sheet whose first row has the names of its columns.

    Raises
    ------
    DataError
        The file is no Parquet with numbers and text.
    """
    names, rows, _ = parquet_cells(path)
    refuse_wide(len(names), path, 1)
    lines = [tuple(names), *rows]
    return Sheet(path, "", tuple(SheetRow(line, cells) for line, cells in enumerate(lines, start=1)))


def taken_apart(sheet: Sheet) -> Sheet:
    """Convert a workbook sheet with labelled or bracketed cells to one with plain cells.

    Other sheets are returned unchanged.
    """
    if sheet.spoilt or sheet.groups or not sheet.rows:
        return sheet
    lines = [""] * sheet.rows[-1].line
    for row in sheet.rows:
        lines[row.line - 1] = ";".join(row.cells)
    if (found := labelled(lines)) is None:
        return sheet
    return replace(sheet, rows=_of_labels(lines, found, sheet.path), said=(*sheet.said, TAKEN_APART))


def _of_labels(lines: list[str], found: Labelled, path: Path) -> tuple[SheetRow, ...]:
    """Build the rows of a table of labelled lines; other lines are remarks."""
    cells = dict(found.rows)
    first = found.rows[0][0]
    out = []
    for i, line in enumerate(lines):
        if i == first and found.names:
            out.append(SheetRow(i + 1, found.names))
        if i in cells:
            refuse_wide(len(cells[i]), path, i + 1)
            out.append(SheetRow(i + 1, cells[i]))
        elif line.strip():
            out.append(SheetRow(i + 1, tuple(line.split()), comment=True))
    return tuple(out)


def _rows(text: str, path: Path, separator: str) -> list[SheetRow]:
    """Split text into rows without empty ones, comment marks and remarks behind `//`."""
    lines = text.split("\n")
    marks = [_COMMENT.match(line) for line in lines]
    bare = [
        line[mark.end() :] if mark else _REMARK.sub("", line) for line, mark in zip(lines, marks, strict=True)
    ]
    rows: list[tuple[int, list[str]]]
    if separator == "blanks":
        rows = []
        for i, line in enumerate(bare, 1):
            found = _BLANKS.findall(line)
            refuse_wide(len(found), path, i)
            rows.append((i, [cell.strip('"') for cell in found]))
    else:
        rows = rows_of("\n".join(bare), path, SEPARATORS[separator])
    out = []
    for line, cells in rows:
        stripped = tuple(cell.strip() for cell in cells)
        if any(stripped):
            out.append(SheetRow(line, stripped, marks[line - 1] is not None))
    return out


def wide_blanks(path: Path, line: int) -> list[str]:
    """Split a line at a tab or two blanks, so that names may contain single blanks."""
    text = _text(path)[0].split("\n")[line - 1]
    mark = _COMMENT.match(text)
    return [cell for cell in _WIDE.split(text[mark.end() if mark else 0 :].strip()) if cell]


def _separator(text: str, path: Path) -> str:
    """Find the separator of a table.

    Raises
    ------
    DataError
        No separator makes a table, and one makes too many columns.
    """
    found: dict[str, tuple[int, int]] = {}
    refusal: DataError | None = None
    for name in SEPARATORS:
        try:
            found[name] = _tableness(_rows(text, path, name))
        except DataError as error:
            refusal = error
    if refusal is not None and not any(rows for rows, _ in found.values()):
        raise refusal
    return max(found, key=lambda name: found[name])


def _tableness(rows: list[SheetRow]) -> tuple[int, int]:
    """Score rows as a table.

    The score is the number of rows with numbers that have the most common width, and the number of their
    numbers.
    """
    numbers = [
        (len(row.cells), sum(map(is_number, row.cells)))
        for row in rows
        if not row.comment and sum(map(is_number, row.cells)) >= FEWEST_NUMBERS
    ]
    if not numbers:
        return 0, 0
    width = Counter(width for width, _ in numbers).most_common(1)[0][0]
    of_width = [count for each, count in numbers if each == width]
    return len(of_width), sum(of_width)


def _text(path: Path) -> tuple[str, tuple[str, ...]]:
    """Decode a file with its encoding; return the text and remarks on the encoding."""
    data = read_bytes(path, MOST_BYTES)
    for mark, name in ((b"\xff\xfe", "utf-16"), (b"\xfe\xff", "utf-16")):
        if data.startswith(mark):
            return _decode(data, name, path), ("is UTF-16",)
    half = data[: 2 * _LOOKED_AT]
    for offset, name in ((1, "utf-16-le"), (0, "utf-16-be")):
        if len(half) > 20 and half[offset::2].count(0) > 0.8 * len(half[offset::2]):
            return _decode(data, name, path), ("is UTF-16 without its mark",)
    if b"\0" in data:
        raise DataError(
            "is not a text file.", do="Export it as text (CSV) or as a workbook (.xlsx).", file=path
        )
    try:
        data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return _decode(data, "cp1252", path), ("is not UTF-8: read as Windows-1252 (Latin-1)",)
    return decoded(data, path), ()


def _decode(data: bytes, encoding: str, path: Path) -> str:
    try:
        text = data.decode(encoding)
    except UnicodeDecodeError as error:
        raise DataError(
            f"is not text in the encoding {encoding}.", do="Save it as UTF-8.", file=path
        ) from error
    return text.replace("\r\n", "\n").replace("\r", "\n").lstrip("\ufeff")
