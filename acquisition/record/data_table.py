"""The data set of a record in memory: the cells as they are written, and what the header says of all of them."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import tomli_w

from calib.convert import Table
from calib.data import Dataset, dataset_of, header_of
from calib.text import Columns


@dataclass(frozen=True)
class DataTable:
    """Columns named as the data-set format names them (all of one length), and the table of the header.

    name: the record, as refusals name it.
    """

    name: str
    columns: dict[str, list[str]]
    header: dict[str, Any]

    @property
    def rows(self) -> list[dict[str, str]]:
        """The cells of every row by the name of their column."""
        return [
            dict(zip(self.columns, cells, strict=True)) for cells in zip(*self.columns.values(), strict=True)
        ]

    def dataset(self) -> Dataset:
        """The data set for a calibration. Raises DataError as for its files, which need not have been written."""
        path, table = Path(self.name) / "data.csv", self._as_written
        lines = list(enumerate(zip(*self.columns.values(), strict=True), start=2))  # below the names
        cells = Columns(path, list(self.columns), lines, hashlib.sha256(table.text.encode()).hexdigest())
        return dataset_of(cells, header_of(self.header, path.with_suffix(".toml"), table.header))

    def write(self, out: Path) -> Path:
        """Write `OUT.csv` and `OUT.toml`, each whole or not at all. Returns the path of the CSV. Raises OSError."""
        out = out.with_suffix(".csv")
        self._as_written.write(out)
        return out

    @property
    def _as_written(self) -> Table:
        return Table(self.columns, tomli_w.dumps(self.header))
