"""Readings of one foreign file, from its map.

Every cell that the map needs is a number; otherwise the file is refused with line, column and content of
the cell. Nothing is filled in except as the map states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from calib.array import Array
from calib.errors import DataError
from calib.foreign.files.layout import Layout
from calib.foreign.files.number import NOT_MEASURED, Notation, looks_like_date, seconds_of
from calib.foreign.map.entry import ANGLES, DATE, Column, column_of, refuse_angles, refuse_points
from calib.foreign.map.map_file import MATRIX, UNITLESS, FileMap, Map, quaternions
from calib.foreign.readings.matching import matched
from calib.foreign.readings.readings import ForeignReadings, joined

_TEXTS = ("id", "pose", "series", "set", "target", "waypoint", "visit")


def readings_of(
    made: Map, layouts: Sequence[Layout], map_path: Path | str
) -> tuple[ForeignReadings, tuple[str, ...]]:
    """Read files whose layouts are in the order of the map.

    Also returns remarks on rows that are left out.

    Raises
    ------
    DataError
        The map is undecided, or a cell cannot be read; the error names file and line.
    """
    made.refuse_undecided(map_path)
    parts = [
        File(each, layout, map_path).readings() for each, layout in zip(made.files, layouts, strict=True)
    ]
    if len(parts) == 1:
        return parts[0], ()
    way = 1 if made.files[0].with_joints else -1
    joints, points = parts[::way]
    rows = matched(joints, points, made, layouts[::way], map_path)
    return joined(joints, points, (rows.joints, rows.points), rows.targets), rows.said


class File:
    """A file and its map; `map_path` names the map in messages."""

    def __init__(self, made: FileMap, layout: Layout, map_path: Path | str) -> None:
        self.made, self.layout, self.map_path = made, layout, map_path
        self.notation = Notation(made.decimal, made.thousands)

    def readings(self) -> ForeignReadings:
        """Read the rows of the file, one per target.

        Raises
        ------
        DataError
            A cell cannot be read; the error names file and line.
        """
        columns, count = self.made.columns, len(self.layout.rows)
        axes = sorted(
            (q for q in columns if q[0] in "je" and q[1:].isdigit()), key=lambda q: (q[0] == "e", int(q[1:]))
        )
        entries = [self._column(axis) for axis in axes]
        joints = self._matrix(entries, required=True)
        refuse_angles(joints, entries, self.layout.sheet.shown)
        numbers = {
            q: self._matrix([self._column(q)])[:, 0] for q in columns if q.startswith(("read", "prev"))
        }
        numbers |= {q: self._matrix([self._plain(q)])[:, 0] for q in columns if q.startswith("approach")}
        if "time" in columns:
            numbers["time"] = self._times(self._column("time"))
        if "t_air" in columns:
            numbers["t_air"] = self._matrix([self._column("t_air")])[:, 0]
        rows = ForeignReadings(
            joints=joints,
            axes=tuple(axes),
            units=tuple("deg" if entry.unit in ANGLES else "mm" for entry in entries),
            points=np.full((count, 3), np.nan),
            turns=self._turns(),
            texts={q: self._texts(q) for q in _TEXTS if q in columns},
            numbers=numbers,
            rejected=self._rejected(),
        )
        if "x" in columns:
            return replace(rows, points=self._points(columns))
        return self._by_target(rows) if self.made.targets else rows

    def _by_target(self, rows: ForeignReadings) -> ForeignReadings:
        """Split readings into one row for each target, if a row of the file holds several."""
        points = [self._points(axes) for axes in self.made.targets.values()]
        every = rows.take(np.repeat(np.arange(len(rows)), len(points)))
        target = tuple(self.made.targets) * len(rows)
        texts = {**every.texts, "target": target}
        if "id" in texts and len(points) > 1:
            texts["id"] = tuple(f"{name}-{of}" for name, of in zip(every.texts["id"], target, strict=True))
        return replace(every, points=np.stack(points, axis=1).reshape(-1, 3), texts=texts)

    def _column(self, quantity: str, entries: Mapping[str, str] | None = None) -> Column:
        key = f"columns.{quantity}"
        column = column_of((entries or self.made.columns)[quantity], quantity, key, str(self.map_path))
        return self._known(column, key)

    def _plain(self, quantity: str) -> Column:
        return self._known(Column(self.made.columns[quantity], "", 1.0), f"columns.{quantity}")

    def _known(self, column: Column, key: str) -> Column:
        if column.name not in self.layout.names:
            raise DataError(
                f"names the column '{column.name}', which {self.layout.sheet.shown} does not have.",
                do=f"There are {', '.join(self.layout.names)}.",
                file=self.map_path,
                key=key,
            )
        return column

    def _texts(self, quantity: str) -> tuple[str, ...]:
        cells = self.layout.cells[self._plain(quantity).name]
        return self._filled(cells) if quantity in self.made.fill_down else cells

    def _filled(self, cells: tuple[str, ...]) -> tuple[str, ...]:
        out, last = [], ""
        for cell in cells:
            last = cell or last
            out.append(last)
        return tuple(out)

    def _matrix(self, columns: Sequence[Column], *, required: bool = False) -> Array:
        """Read numbers in internal units, shape (rows, columns); NaN if a cell was not measured."""
        out = np.full((len(self.layout.rows), len(columns)), np.nan)
        for k, column in enumerate(columns):
            cells = self.layout.cells[column.name]
            if required and "joints" in self.made.fill_down:
                cells = self._filled(cells)
            for i, cell in enumerate(cells):
                value = self.notation.number(cell)
                if value is not None:
                    out[i, k] = value * column.factor
                elif required or cell.lower() not in NOT_MEASURED or self.layout.spoilt(i, column.name):
                    raise self._refused(i, column.name, cell)
        return out

    def _refused(self, row: int, name: str, cell: str) -> DataError:
        why = self.layout.spoilt(row, name)
        if why:
            what, do = why, "Open it in Excel, make the cell a number, and save it"
        elif not cell:
            what = "is empty"
            do = "Fill it, or remove the line; where empty means as above, fill_down = ['joints'] in the map"
        else:
            what, do = f"is {cell[:40]!r}, not a number", "Correct it, or remove the line"
            if looks_like_date(cell):
                what = f"is {cell[:40]!r}: a spreadsheet has made a date of a number"
                do = "Set the column to numbers and enter it again"
        return DataError(
            f"column '{name}' {what}.", do=f"{do}.", file=self.layout.sheet.shown, line=self.layout.lines[row]
        )

    def _points(self, axes: Mapping[str, str]) -> Array:
        columns = [self._column(axis, axes) for axis in "xyz"]
        points = self._matrix(columns)
        measured = np.isfinite(points)
        for i in np.flatnonzero(measured.any(axis=1) & ~measured.all(axis=1))[:1]:
            name = columns[int(np.flatnonzero(~measured[i])[0])].name
            raise DataError(
                f"column '{name}' is empty, and other coordinates of the row are not.",
                do="Fill it, or leave x, y and z all empty if nothing was measured.",
                file=self.layout.sheet.shown,
                line=self.layout.lines[i],
            )
        refuse_points(points, columns, self.layout.sheet.shown)
        return points

    def _turns(self) -> Array:
        """Read the orientations in the map's convention, shape (rows, 4); NaN without."""
        columns = self.made.columns
        if "rot_w" in columns:
            turns = self._matrix([self._plain(q) for q in UNITLESS])
            norm = np.linalg.norm(turns, axis=1)
            for i in np.flatnonzero(np.abs(norm - 1.0) > 1e-2)[:1]:
                raise DataError(
                    f"the quaternion has the norm {norm[i]:.4f}.",
                    do="Check the columns of the quaternion in the map: its norm is 1.",
                    file=self.layout.sheet.shown,
                    line=self.layout.lines[i],
                )
            return turns / norm[:, None]
        if MATRIX[0] in columns:
            matrices = self._matrix([self._plain(q) for q in MATRIX]).reshape(-1, 3, 3)
            given = np.isfinite(matrices).all(axis=(1, 2))
            off = np.abs(matrices @ matrices.transpose(0, 2, 1) - np.eye(3)).max(axis=(1, 2))
            for i in np.flatnonzero(given & ((off > 1e-2) | (np.linalg.det(np.nan_to_num(matrices)) < 0.0)))[
                :1
            ]:
                raise DataError(
                    "the matrix is not a rotation: its rows are not at right angles, of length 1 and right-handed.",
                    do="Check the columns rot_11 to rot_33 in the map.",
                    file=self.layout.sheet.shown,
                    line=self.layout.lines[i],
                )
            turns = np.full((len(matrices), 4), np.nan)
            if given.any():
                turns[given] = Rotation.from_matrix(matrices[given]).as_quat(scalar_first=True)
            return turns
        if "rot_1" in columns:
            angles = self._matrix([self._column(f"rot_{k}") for k in (1, 2, 3)])
            return quaternions(angles, self.made.rotation)
        return np.full((len(self.layout.rows), 4), np.nan)

    def _times(self, column: Column) -> Array:
        if column.unit != DATE:
            return self._matrix([column])[:, 0]
        out = [seconds_of(cell) for cell in self.layout.cells[column.name]]
        for i, seconds in enumerate(out):
            if seconds is None:
                raise DataError(
                    f"column '{column.name}' is {self.layout.cells[column.name][i][:40]!r}, which is not a date with a "
                    f"time of day.",
                    do="Write YYYY-MM-DD HH:MM:SS, or leave the time out of the map.",
                    file=self.layout.sheet.shown,
                    line=self.layout.lines[i],
                )
        return np.array(out, dtype=np.float64)

    def _rejected(self) -> tuple[str, ...]:
        """Return the reason why each row does not count, or ''."""
        if "status" not in self.made.columns:
            return ("",) * len(self.layout.rows)
        cells = self.layout.cells[self._plain("status").name]
        good = {word.lower() for word in self.made.status_ok}
        good = good or {""}  # a column that only marks what does not count
        return tuple("" if cell.lower() in good else f"rejected:{cell or 'no status'}" for cell in cells)
