"""The cells of a table by column, with the line of every row, so that a refusal can name its place."""

from __future__ import annotations

import copy
import hashlib
import math
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.errors import DataError
from calib.text.csv_text import other_mark, refuse_twice, rows_of
from calib.text.formula import meant_by
from calib.text.text_file import read_text


class Columns:
    """A table of text: its rows, each with the line on which it is in the file `path`.

    sha256: the hash of the file's text.
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
    def read(cls, path: Path) -> Columns:
        """A CSV file read whole. Raises DataError (file, line) for what is not a table of UTF-8 text."""
        return cls.of_text(read_text(path), path)

    @classmethod
    def of_text(cls, text: str, path: Path) -> Columns:
        """The table that CSV text holds; `path` is what messages call it. Raises DataError (file, line)."""
        if text.lstrip().startswith("{"):
            raise DataError(
                "is JSON, not a table.", do="Give a data set: a CSV with its header beside it.", file=path
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

    def where(self, keep: NDArray[np.bool_]) -> Columns:
        """Some of the rows, by mask (n,), each with the line where it is."""
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
        """(n,) cells without surrounding blanks, and without the ' before what a spreadsheet would work out; `default`
        for empty cells and for an absent column."""
        if name not in self._cells:
            return np.full(len(self), default)
        return np.array([meant_by(cell.strip()) or default for cell in self._cells[name]])

    def numbers(self, name: str, *, required: bool = False) -> Array:
        """(n,) numbers; an empty cell is NaN, unless `required`. A cell that is not a finite number is refused."""
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
        """The refusal of one cell, naming its line and column."""
        return DataError(f"column '{name}' {what}.", do=f"{do}.", file=self.path, line=self.lines[row])
