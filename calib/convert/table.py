"""A foreign file that becomes a data set: columns of text, a header, and which rows are held out."""

from __future__ import annotations

import csv
import io
import re
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np

from calib.errors import DataError
from calib.text.files import replace_file
from calib.text.formula import no_formula

Holdout = Literal["random", "block"]
BLOCKS = 20
_JOINT = re.compile(r"j\d+_deg")


@dataclass(frozen=True)
class Table:
    """Columns named as the data-set format names them (all of one length), and the text of the header."""

    columns: dict[str, list[str]]
    header: str

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    def hold_out(self, kind: Holdout, share: float, seed: int) -> Table:
        """Mark a share of the rows as validation: whole poses drawn at random, or blocks of consecutive rows.

        A random hold-out is optimistic: its neighbours took part in the fit. Readings of one pose are held out
        together, or the fit would have seen what it is to predict. Raises DataError for a share outside (0, 1).
        """
        if not 0.0 < share < 1.0:
            raise DataError(
                f"a share of {share:g} cannot be held out.", do="Give a share between 0 and 1.", key="--share"
            )
        n, random = len(self), np.random.default_rng(seed)
        held = np.zeros(n, dtype=bool)
        if kind == "random":
            pose = self._poses()
            count = max(pose) + 1
            held = np.isin(pose, random.choice(count, round(share * count), replace=False))
        else:
            block = np.arange(n) * BLOCKS // n
            held = np.isin(block, random.choice(BLOCKS, max(1, round(share * BLOCKS)), replace=False))
        columns = {}
        for name, cells in self.columns.items():
            columns[name] = cells
            if name == "reading_id":
                columns["set"] = ["validation" if row else "calibration" for row in held]
        header = f'{self.header}\n[holdout]\nkind = "{kind}"\nshare = {share:g}\nseed = {seed}\n'
        return replace(self, columns=columns, header=header)

    def _poses(self) -> list[int]:
        """The pose of every row, numbered as they appear: its waypoint, or its joints as they are written."""
        joints = [cells for name, cells in self.columns.items() if _JOINT.fullmatch(name)]
        if "waypoint" in self.columns:
            joints = [self.columns["waypoint"]]
        seen: dict[tuple[str, ...], int] = {}
        rows = zip(*joints, strict=True) if joints else ((str(i),) for i in range(len(self)))
        return [seen.setdefault(row, len(seen)) for row in rows]

    @property
    def text(self) -> str:
        """The columns as CSV, their names in the first line; what a spreadsheet would work out has a ' before it."""
        text = io.StringIO()
        writer = csv.writer(text, lineterminator="\n")
        writer.writerow(self.columns)
        writer.writerows(
            zip(*([no_formula(cell) for cell in cells] for cells in self.columns.values()), strict=True)
        )
        return text.getvalue()

    def write(self, path: Path) -> None:
        """Write `path` and the `.toml` beside it; neither is left half-written."""
        replace_file(path.with_suffix(".toml"), self.header)
        replace_file(path, self.text)
