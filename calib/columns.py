"""The cells of a CSV file by column, with the line of every row, so that a refusal can name its place."""

from __future__ import annotations

import hashlib
import math
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.csv_text import refuse_twice, rows_of
from calib.errors import DataError
from calib.kinematics import Array
from calib.text_file import read_text


class Columns:
    """A CSV file read whole. Raises DataError (file, line) for what is not a table of UTF-8 text."""

    def __init__(self, path: Path) -> None:
        self.path = path
        text = read_text(path)
        lines = rows_of(text, path)
        if not lines:
            raise DataError("is empty.", do="It must have a header row and readings.", file=path)
        self.names = [name.strip() for name in lines[0][1]]
        if len(self.names) == 1 and ";" in self.names[0]:
            raise DataError(
                "is separated by semicolons.",
                do="Save it with commas and decimal points, or import it with 'truepose convert'.",
                file=path,
                line=1,
            )
        refuse_twice(self.names, path)
        rows = [(number, line) for number, line in lines[1:] if any(cell.strip() for cell in line)]
        for number, line in rows:
            if len(line) != len(self.names):
                raise DataError(
                    f"has {len(line)} cells where the header has {len(self.names)} columns.",
                    do="Mend that line.",
                    file=path,
                    line=number,
                )
        if not rows:
            raise DataError("has a header row but no readings.", do="Add readings.", file=path)
        self.lines = [number for number, _ in rows]
        self._cells = dict(zip(self.names, zip(*(line for _, line in rows), strict=True), strict=True))
        self.sha256 = hashlib.sha256(text.encode()).hexdigest()

    def __contains__(self, name: str) -> bool:
        return name in self._cells

    def __len__(self) -> int:
        return len(self.lines)

    def require(self, name: str, do: str) -> None:
        """Raise DataError when there is no such column."""
        if name not in self._cells:
            raise DataError(f"column '{name}' is missing.", do=do, file=self.path, line=1)

    def text(self, name: str, default: str = "") -> NDArray[np.str_]:
        """(n,) cells without surrounding blanks; `default` for empty cells and for an absent column."""
        if name not in self._cells:
            return np.full(len(self), default)
        return np.array([cell.strip() or default for cell in self._cells[name]])

    def numbers(self, name: str, *, required: bool = False) -> Array:
        """(n,) numbers; an empty cell is NaN, unless `required`. A cell that is not a finite number is refused."""
        if name not in self._cells:
            return np.full(len(self), np.nan)
        out = np.empty(len(self))
        for i, cell in enumerate(self._cells[name]):
            if not cell.strip():
                if required:
                    raise self.refuse(i, name, "is empty", "Every reading needs it")
                out[i] = np.nan
                continue
            try:
                out[i] = float(cell)
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
