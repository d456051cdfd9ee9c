"""Cells of a CSV table by column, with the line of every row for error messages.

The lengths of lines and the number of columns are bounded.

Cells that a spreadsheet would evaluate as formulas are escaped so that it does not. Source: OWASP, CSV
injection (a cell that begins with = + - @, a tab or an end of line).
"""

from __future__ import annotations

import copy
import csv
import hashlib
import io
import math
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.errors import DataError
from calib.text.parquet import PARQUET, parquet_cells
from calib.text.text_file import read_text

LONGEST_LINE = 100_000
MOST_COLUMNS = 1_000
"""A robot of six joints with everything that can be measured has 60."""

_BEGINS = ("=", "+", "-", "@", "\t", "\r", "\n")


class TextTable:
    """A table of text: its rows, each with the line on which it is in the file `path`.

    `sha256` is the hash of the file's text.
    """

    def __init__(
        self, path: Path, names: Sequence[str], rows: Sequence[tuple[int, Sequence[str]]], sha256: str
    ) -> None:
        self.path = path
        self.names = list(names)
        self.lines = [number for number, _ in rows]
        self.sha256 = sha256
        self._cells = dict(zip(self.names, zip(*(line for _, line in rows), strict=True), strict=True))

    @classmethod
    def read(cls, path: Path) -> TextTable:
        """Read a CSV or Parquet file. Rows of a Parquet have the lines that they would have in a CSV.

        Raises
        ------
        DataError
            The file is not a table of UTF-8 text, or of Parquet; the error names file, and line or column.
        """
        if path.suffix.lower() != PARQUET:
            return cls.of_text(read_text(path), path)
        names, rows, content = parquet_cells(path)
        refuse_wide(len(names), path, 1)
        refuse_twice(names, path)
        if not rows:
            raise DataError("has no readings.", do="Add readings.", file=path)
        cells = [(line, [no_formula(cell) for cell in row]) for line, row in enumerate(rows, start=2)]
        return cls(path, names, cells, hashlib.sha256(content).hexdigest())

    @classmethod
    def of_text(cls, text: str, path: Path) -> TextTable:
        """Parse CSV text to a table; `path` is its name in messages.

        Raises
        ------
        DataError
            The text is not a table; the error names file and line.
        """
        if text.lstrip().startswith("{"):
            raise DataError(
                "is JSON, not a table.",
                do="Give a data set: a CSV with its header in the same folder.",
                file=path,
            )
        lines = rows_of(text, path)
        if not lines:
            raise DataError("is empty.", do="It must have a header row and readings.", file=path)
        names = [name.strip() for name in lines[0][1]]
        if (other := other_mark(names)) is not None:
            raise DataError(
                f"is separated by {other}.",
                do="Save it with commas and decimal points, or import it with 'truepose convert'.",
                file=path,
                line=1,
            )
        refuse_twice(names, path)
        rows = [(number, line) for number, line in lines[1:] if any(cell.strip() for cell in line)]
        for number, line in rows:
            if len(line) != len(names):
                raise DataError(
                    f"has {len(line)} cells where the header has {len(names)} columns.",
                    do="Correct that line.",
                    file=path,
                    line=number,
                )
        if not rows:
            raise DataError("has a header row but no readings.", do="Add readings.", file=path)
        return cls(path, names, rows, hashlib.sha256(text.encode()).hexdigest())

    def __contains__(self, name: str) -> bool:
        return name in self._cells

    def __len__(self) -> int:
        return len(self.lines)

    def where(self, keep: NDArray[np.bool_]) -> TextTable:
        """Select rows by a mask (n,), each with its line."""
        few = copy.copy(self)
        rows = np.flatnonzero(keep).tolist()
        few.lines = [self.lines[i] for i in rows]
        few._cells = {name: tuple(cells[i] for i in rows) for name, cells in self._cells.items()}
        return few

    def require(self, name: str, do: str) -> None:
        """Raise DataError when there is no such column."""
        if name not in self._cells:
            raise DataError(f"column '{name}' is missing.", do=do, file=self.path, line=1)

    def text(self, name: str, default: str = "") -> NDArray[np.str_]:
        """Return the cells of a column without surrounding blanks, shape (n,).

        The ' before a text that a spreadsheet would evaluate is removed. Empty cells and an absent
        column give `default`.
        """
        if name not in self._cells:
            return np.full(len(self), default)
        return np.array([meant_by(cell.strip()) or default for cell in self._cells[name]])

    def numbers(self, name: str, *, required: bool = False) -> Array:
        """Parse the numbers of a column, shape (n,); an empty cell is NaN, unless `required`.

        A cell that is not a finite number is refused.
        """
        if name not in self._cells:
            return np.full(len(self), np.nan)
        cells = [cell.replace("_", "?") for cell in self._cells[name]]  # Python reads 1_5 as 15
        with suppress(ValueError):  # cell by cell where one is no number, to name its line
            plain = np.array(cells, dtype=np.float64)
            if np.isfinite(plain).all():
                return plain
        out = np.empty(len(self))
        for i, cell in enumerate(self._cells[name]):
            if not cell.strip():
                if required:
                    raise self.refuse(i, name, "is empty", "Every reading needs it")
                out[i] = np.nan
                continue
            try:
                out[i] = float(cells[i])
            except ValueError as error:
                raise self.refuse(
                    i, name, f"is {cell.strip()!r}, not a number", "Use a decimal point"
                ) from error
            if not math.isfinite(out[i]):
                raise self.refuse(
                    i, name, f"is {cell.strip()!r}", "Leave the cell empty when nothing was measured"
                )
        return out

    def refuse(self, row: int, name: str, what: str, do: str) -> DataError:
        """Build the error for one cell, naming its line and column."""
        return DataError(f"column '{name}' {what}.", do=f"{do}.", file=self.path, line=self.lines[row])


def rows_of(text: str, file: Path | str, delimiter: str = ",") -> list[tuple[int, list[str]]]:
    """Split text into rows, each with its line number, from 1, and its cells.

    Raises
    ------
    DataError
        The text is no table; the error names file and line.
    """
    reader = csv.reader(taken(io.StringIO(text, newline="\n"), file), delimiter=delimiter)
    out = []
    try:
        for row in reader:
            refuse_wide(len(row), file, reader.line_num)
            out.append((reader.line_num, row))
    except csv.Error as error:
        raise DataError(
            f"cannot be read ({error}).", do="Correct that line.", file=file, line=reader.line_num
        ) from error
    return out


def refuse_wide(columns: int, file: Path | str, line: int) -> None:
    """Raise DataError when a row has more columns than are taken."""
    if columns > MOST_COLUMNS:
        raise DataError(
            f"has {columns} columns; at most {MOST_COLUMNS} are taken.",
            do="Leave out columns that are not used.",
            file=file,
            line=line,
        )


def other_mark(names: Sequence[str]) -> str | None:
    """Return the word for the sign that separates a header row, or None for commas."""
    marks = {";": "semicolons", "\t": "tabs"}
    return next((word for mark, word in marks.items() if len(names) == 1 and mark in names[0]), None)


def refuse_twice(names: Sequence[str], file: Path | str) -> None:
    """Raise DataError when a column of the header row occurs twice."""
    name, count = Counter(name for name in names if name).most_common(1)[0] if any(names) else ("", 0)
    if count > 1:
        raise DataError(f"column '{name}' occurs twice.", do="Keep one.", file=file, line=1)


def taken(lines: Iterable[str], file: Path | str, do: str = "Correct that line.") -> Iterator[str]:
    """Yield the lines of a file.

    Raises
    ------
    DataError
        A line is longer than `LONGEST_LINE`; the error names file and line.
    """
    for number, line in enumerate(lines, start=1):
        if len(line) > LONGEST_LINE:
            raise DataError(
                f"has {len(line)} characters; at most {LONGEST_LINE} are taken.",
                do=do,
                file=file,
                line=number,
            )
        yield line


def no_formula(text: str) -> str:
    """Escape a text so that a spreadsheet does not evaluate it: `'` before it.

    Numbers stay numbers.
    """
    if not text.startswith(_BEGINS):
        return text
    try:
        float(text)
    except ValueError:
        return f"'{text}"
    return text


def meant_by(cell: str) -> str:
    """Undo `no_formula` for a cell."""
    return cell[1:] if cell.startswith("'") and no_formula(cell[1:]) == cell else cell
