"""Readings of foreign files by their map: joints, points, orientations and names of every row, in the program's units.

Every cell that the map needs is a number, or the file is refused by line and column with what is there; nothing is filled in
but what the map says. Points of a second file are matched to the joints by name, by order or by time, as the map says.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.errors import DataError
from calib.foreign.dates import seconds_of
from calib.foreign.entry import DATE, Column, column_of
from calib.foreign.layout import Layout
from calib.foreign.map_file import UNITLESS, FileMap, Map
from calib.foreign.matching import matched
from calib.foreign.number import Notation
from calib.foreign.rotations import quaternions
from calib.units import DEG

NOT_MEASURED = ("", "-", "--", "---", "nan", "n/a", "na", "#n/a", "null", "none", "lost", "no point", "x")
_MOST_RAD = 4.0 * np.pi + 1e-3
_LARGE_DEG = 2.0 * np.pi + 1e-3
_FEW = 5
_SMALL_MM, _HUGE_MM = 12.0, 100_000.0


@dataclass(frozen=True)
class Readings:
    """n readings. joints (n, N) in rad, or mm where `slides` says so; points (n, 3) mm, NaN where not measured; turns
    (n, 4) quaternions, scalar first, or NaN; texts: quantity -> (n,) names; numbers: further quantities (n,)."""

    joints: Array
    slides: tuple[bool, ...]
    points: Array
    turns: Array
    texts: Mapping[str, tuple[str, ...]]
    numbers: Mapping[str, Array]
    said: tuple[str, ...] = ()
    rejected: tuple[str, ...] = field(default=())

    def __len__(self) -> int:
        return len(self.joints)

    def take(self, rows: NDArray[np.int64]) -> Readings:
        """Some of the readings, by index."""
        return Readings(
            self.joints[rows], self.slides, self.points[rows], self.turns[rows],
            {key: tuple(cells[i] for i in rows) for key, cells in self.texts.items()},
            {key: values[rows] for key, values in self.numbers.items()},
            self.said, tuple(self.rejected[i] for i in rows),
        )  # fmt: skip


def readings_of(made: Map, layouts: Sequence[Layout], map_path: Path | str) -> Readings:
    """The readings of files whose layouts are in the order of the map. Raises DataError (file, line)."""
    made.refuse_undecided(map_path)
    parts = [
        _File(each, layout, map_path).readings() for each, layout in zip(made.files, layouts, strict=True)
    ]
    if len(parts) == 1:
        return parts[0]
    first = made.files[0].with_joints
    joints, points = parts if first else parts[::-1]
    files = layouts if first else layouts[::-1]
    rows = matched(joints, points, made, files, map_path)
    of, to = rows.joints, rows.points
    joints, points = joints.take(of), points.take(to)
    texts = {**joints.texts, **points.texts}
    if "pose" in joints.texts:
        texts["pose"] = joints.texts["pose"]
    if rows.targets is not None:
        texts["target"] = rows.targets
    return Readings(
        joints.joints, joints.slides, points.points, points.turns, texts, {**joints.numbers, **points.numbers},
        (*joints.said, *points.said, *rows.said),
        tuple(a or b for a, b in zip(joints.rejected, points.rejected, strict=True)),
    )  # fmt: skip


class _File:
    """One file and its map."""

    def __init__(self, made: FileMap, layout: Layout, map_path: Path | str) -> None:
        self.made, self.layout, self.map_path = made, layout, map_path
        self.notation = Notation(made.decimal, made.thousands)
        self.said: list[str] = []

    def readings(self) -> Readings:
        """The rows of the file, one a target."""
        made, columns = self.made, self.made.columns
        names = sorted(
            (q for q in columns if q[0] in "je" and q[1:].isdigit()), key=lambda q: (q[0] == "e", int(q[1:]))
        )
        entries = [self._column(q) for q in names]
        slides = tuple(entry.unit in ("mm", "m", "um", "cm", "in") for entry in entries)
        joints = self._matrix(entries, required=True)
        self._refuse_other_angles(joints, entries)
        reads = {q: self._matrix([self._column(q)])[:, 0] for q in columns if q.startswith(("read", "prev"))}
        sides = {q: self._matrix([self._plain(q)])[:, 0] for q in columns if q.startswith("approach")}
        numbers: dict[str, Array] = {**reads, **sides}
        if "time" in columns:
            numbers["time"] = self._times(self._column("time"))
        if "t_air" in columns:
            numbers["t_air"] = self._matrix([self._column("t_air")])[:, 0]
        texts = {
            q: self._texts(q)
            for q in ("id", "pose", "series", "set", "target", "waypoint", "visit")
            if q in columns
        }
        turns = self._turns()
        rejected = self._rejected()
        groups = dict(made.targets) or ({"": columns} if "x" in columns else {})
        if not groups:
            n = len(self.layout.rows)
            return Readings(
                joints, slides, np.full((n, 3), np.nan), turns, texts, numbers, tuple(self.said), rejected
            )
        points = {name: self._points(axes) for name, axes in groups.items()}
        count = len(points)
        rows = np.repeat(np.arange(len(self.layout.rows)), count)
        every = np.stack(list(points.values()), axis=1).reshape(-1, 3)
        whole = Readings(
            joints, slides, np.zeros((len(joints), 3)), turns, texts, numbers, tuple(self.said), rejected
        ).take(rows)
        if made.targets:
            target = tuple(points) * len(self.layout.rows)
            ids = (
                {"id": tuple(f"{i}-{t}" for i, t in zip(whole.texts["id"], target, strict=True))}
                if "id" in texts and count > 1
                else {}
            )
            return Readings(whole.joints, slides, every, whole.turns, {**whole.texts, **ids, "target": target}, whole.numbers,
                            whole.said, whole.rejected)  # fmt: skip
        return Readings(
            whole.joints, slides, every, whole.turns, whole.texts, whole.numbers, whole.said, whole.rejected
        )

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
        """(rows, columns) of numbers in the program's units; NaN where a cell says that nothing was measured."""
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
            do = 'Fill it, or remove the line; where an empty cell means the one above, fill_down = ["joints"] in the map'
        else:
            what, do = f"is {cell[:40]!r}, not a number", "Correct it, or remove the line"
            if seconds_of(cell) is not None or any(
                month in cell.lower()
                for month in (
                    "jan",
                    "feb",
                    "mar",
                    "mär",
                    "apr",
                    "mai",
                    "may",
                    "jun",
                    "jul",
                    "aug",
                    "sep",
                    "okt",
                    "oct",
                    "nov",
                    "dez",
                    "dec",
                )
            ):
                what, do = (
                    f"is {cell[:40]!r}: a spreadsheet has made a date of a number",
                    "Set the column to numbers and enter it again",
                )
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
                f"column '{name}' is empty beside other coordinates.",
                do="Fill it, or empty x, y and z where nothing was measured.",
                file=self.layout.sheet.shown,
                line=self.layout.lines[i],
            )
        whole = points[measured.all(axis=1)]
        if len(whole) >= _FEW:
            extent = float(np.ptp(whole, axis=0).max())
            if 0.0 < extent < _SMALL_MM or extent > _HUGE_MM:
                raise DataError(
                    f"columns {', '.join(c.name for c in columns)} as {columns[0].unit} span {extent:.4g} mm: no robot is measured so.",
                    do="Correct the unit in the map: [mm], [m], [in], [um].",
                    file=self.layout.sheet.shown,
                )
        return points

    def _turns(self) -> Array:
        columns = self.made.columns
        if "rot_w" in columns:
            turns = self._matrix([self._plain(q) for q in UNITLESS])
            norm = np.linalg.norm(turns, axis=1)
            for i in np.flatnonzero(np.abs(norm - 1.0) > 1e-2)[:1]:
                raise DataError(
                    f"the quaternion has the norm {norm[i]:.4f}.",
                    do="Check the columns rot_w .. rot_z of the map: a quaternion has norm 1.",
                    file=self.layout.sheet.shown,
                    line=self.layout.lines[i],
                )
            return turns / norm[:, None]
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
                    f"column '{column.name}' is {self.layout.cells[column.name][i][:40]!r}, no date with a time of day.",
                    do="Write YYYY-MM-DD HH:MM:SS, or leave the time out of the map.",
                    file=self.layout.sheet.shown,
                    line=self.layout.lines[i],
                )
        return np.array(out, dtype=np.float64)

    def _rejected(self) -> tuple[str, ...]:
        """Why each row does not count, '' where it does."""
        if "status" not in self.made.columns:
            return ("",) * len(self.layout.rows)
        cells = self.layout.cells[self._plain("status").name]
        good = {word.lower() for word in self.made.status_ok}
        good = good or {""}  # a column that only marks what does not count
        return tuple("" if cell.lower() in good else f"rejected:{cell or 'no status'}" for cell in cells)

    def _refuse_other_angles(self, joints: Array, columns: Sequence[Column]) -> None:
        turning = [k for k, column in enumerate(columns) if column.unit in ("deg", "rad", "mrad")]
        if not turning or len(joints) < _FEW:
            return
        largest = np.abs(joints[:, turning]).max(axis=0)
        if all(columns[k].unit == "deg" for k in turning) and largest.max() / DEG <= _LARGE_DEG:
            raise DataError(
                f"no joint exceeds {largest.max() / DEG:.3f} where degrees are meant: these can only be radians.",
                do="Write [rad] for j1 .. in the map.",
                file=self.layout.sheet.shown,
            )
        for size, k in zip(largest, turning, strict=True):
            if columns[k].unit == "rad" and size > _MOST_RAD:
                raise DataError(
                    f"column '{columns[k].name}' holds {size:.0f} where radians are meant: these can only be degrees.",
                    do="Write [deg] in the map.",
                    file=self.layout.sheet.shown,
                )
