"""Files of streams: CSV with units, foreign recordings with a map, and point exports.

Without a map, columns are `t_s`, `j1_deg` .. and `x_mm`, `y_mm`, `z_mm`; a recording by RTDE
(`timestamp`, `actual_q_0` .., rad) is known by its names. Its times may also be milliseconds, microseconds or
nanoseconds since 1970: they are known by their size, converted, and reported.

Point exports are in the style of SpatialAnalyzer, with one point per line: its name, its coordinates,
perhaps a time stamp.

    // SpatialAnalyzer ...                                  comments: version, frame, axes, format
    Path::Tool::p1, 1234.567, 89.012, -345.678, 11/22/2026 08:15:30.125

Names come whole (`Collection::Group::Point`), in up to three fields (collection, group, point) or not at
all; fields are separated by commas, tabs or blanks. The file does not state its unit. Other text behind
the coordinates than a time stamp is ignored: offsets, tolerances, uncertainties, comments. Only
Cartesian coordinates are read. The reader was written from the maker's manual (SA User Manual,
"Exporting ASCII Formatted Points"), not tried on a file of every version.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import Robot, refuse_slides
from calib.array import Array
from calib.errors import DataError
from calib.foreign.files.number import STAMP, seconds_of
from calib.foreign.map.entry import DATE, LENGTHS, TIMES, Column, parse_map
from calib.motion.streams import MEND_TIMES, JointStream, PointStream
from calib.text.columns import TextTable
from calib.text.text_file import read_text
from calib.units import DEG

_MOST_RAD = 4.0 * np.pi + 1e-3  # joints of all robots turn less than twice about to either side
_LARGE_DEG = 2.0 * np.pi + 1e-3
_WRAPS = 1.5 * np.pi  # from one sample to the next: no joint turns so fast
_LARGEST = 1e10  # s, mm or rad: some 300 years of seconds
_SINCE_1970 = (6e8, 4.2e9)  # s, of the years 1989 to 2103: the ranges of ms, us and ns do not overlap
_UNITS = {"ms": "milliseconds", "us": "microseconds", "ns": "nanoseconds"}
_SLOW_S = 2.0  # a sample every two seconds shows no motion, every two milliseconds is usual
_OF_AXIS = re.compile(r"([je]\d{1,3})_(?:deg|mm)")
_EXPORT = re.compile(r"\s*spatial-analyzer\s*\[\s*(\w+)\s*\]\s*")
_NAME_THEM = "Name the columns of a foreign file by a map: time=Timestamp[ms], ..."
_COMMENT = ("//", "#")
_MOST_NAMES = 3
_BLANKS = re.compile(r'"[^"]*"|[^\s,]+')
_LONGEST = 10_000
_FARTHEST = 1e8  # units: what is beyond is no coordinate


def read_joints(path: Path, robot: Robot, coupling: str = "none", columns: str | None = None) -> JointStream:
    """Read the robot's stream and convert controller joints to model angles.

    Raises
    ------
    DataError
        The file is no stream; the error names file, line or column.
    """
    refuse_slides(robot, "aligning streams knows")
    table = TextTable.read(path)
    # what follows other joints stays at 0 in its own column, which may be left out
    held = {robot.axes[k] for k in robot.followers(coupling)}
    there = columns if columns is not None else " ".join(f"{name[:-4]}=" for name in table.names)
    names = [name for name in robot.axes if name not in held or re.search(rf"\b{name}\s*=", there)]
    if columns is None and "actual_q_0" in table:
        names = list(robot.axes)
    if columns is not None:
        of = parse_map(columns, ["time", *names], "--robot-columns")
    elif "actual_q_0" in table:
        of = {name: Column(f"actual_q_{k}", "rad", 1.0) for k, name in enumerate(names)}
        of["time"] = Column("timestamp", "s", 1.0)
    else:
        of = {name: Column(f"{name}_deg", "deg", DEG) for name in names}
        of["time"] = Column("t_s", "s", 1.0)
        for name in table.names:
            axis = _OF_AXIS.fullmatch(name)
            if axis is None or axis[1] in robot.axes:
                continue
            if axis[1].startswith("e") and np.ptp(np.nan_to_num(table.numbers(name))) == 0.0:
                continue  # one that never moved is no part of the arm
            raise DataError(
                f"column '{name}' is there, but the robot {robot.name} has {robot.joints} joints.",
                do="Give the robot that was recorded, or remove the column.",
                file=path,
                line=1,
            )
    time, unit = _times(table, of["time"], declared=columns is not None)
    joints = np.column_stack(
        [_numbers(table, of[name]) if name in names else np.zeros(len(table)) for name in robot.axes]
    )
    _refuse_other_unit(joints[:, [name in names for name in robot.axes]], [of[name] for name in names], path)
    once, remarks = _in_order(table, time, joints, of["time"])
    time, given = time[once], joints[once]
    joints = np.unwrap(given, discont=_WRAPS, axis=0)
    remarks = unit + remarks
    remarks += [
        f"Column '{of[name].name}' wraps at half a turn; the joint was followed across."
        for name, wraps in zip(robot.axes, (joints != given).any(axis=0), strict=True)
        if wraps
    ]
    return JointStream(
        time - time[0],
        robot.model_angles(joints, coupling),
        f"robot stream {path.name}",
        float(time[0]),
        coupling,
        tuple(remarks),
        _simulated(table),
    )


def read_points(path: Path, columns: str | None = None) -> PointStream:
    """Read the instrument's stream.

    Rows whose `status` is not ok, or that hold no point, leave a gap.

    Parameters
    ----------
    path : Path
        File of the stream.
    columns : str, optional
        A map, or `spatial-analyzer[UNIT]` for an export of points with time stamps.

    Raises
    ------
    DataError
        The file is no stream; the error names file, line or column.
    """
    if columns is not None and (match := _EXPORT.fullmatch(columns)):
        return _exported(path, match[1])
    table = TextTable.read(path)
    axes = ("x", "y", "z")
    if columns is not None:
        of = parse_map(columns, ["time", *axes], "--tracker-columns")
    else:
        of = {axis: Column(f"{axis}_mm", "mm", 1.0) for axis in axes}
        of["time"] = Column("t_s", "s", 1.0)
    time, unit = _times(table, of["time"], declared=columns is not None)
    points = np.column_stack([_numbers(table, of[axis], empty=True) for axis in axes])
    status = np.char.lower(table.text("status").astype(str))
    seen = np.isin(status, ("", "ok")) & np.isfinite(points).all(axis=1) & (points != 0.0).any(axis=1)
    if not seen.any():
        raise DataError("has no point that was measured.", do="Check columns and status.", file=path)
    time, points = time[seen], points[seen]
    once, remarks = _in_order(table.where(seen), time, points, of["time"])
    return replace(_points(time[once], points[once], path, unit + remarks), simulated=_simulated(table))


def _exported(path: Path, unit: str) -> PointStream:
    if unit not in LENGTHS:
        raise DataError(f"gives the unit '{unit}'.", do=f"Use {', '.join(LENGTHS)}.", key="--tracker-columns")
    export = read_export(path, LENGTHS[unit])
    if export.time is None:
        raise DataError(
            "has points without time stamps, which cannot be aligned with a moving robot.",
            do="Export the points again with their time stamps.",
            file=path,
        )
    return _points(export.time, export.points, path, [])


def _points(time: Array, points: Array, path: Path, remarks: list[str]) -> PointStream:
    return PointStream(time - time[0], points, f"tracker stream {path.name}", float(time[0]), tuple(remarks))


def _in_order(
    table: TextTable, time: Array, values: Array, column: Column
) -> tuple[NDArray[np.bool_], list[str]]:
    """Mark the rows (n,) to keep; return a remark on the others too.

    Left out are rows whose time (n,) and values (n, c) repeat the row before.

    Raises
    ------
    DataError
        Another time does not increase; the error names the line.
    """
    same = np.append(False, (np.diff(time) == 0.0) & (np.diff(values, axis=0) == 0.0).all(axis=1))
    kept = np.flatnonzero(~same)
    for at in kept[1:][np.diff(time[kept]) <= 0.0][:1]:
        before = time[kept[np.searchsorted(kept, at) - 1]]
        what = "is given twice, with other values" if time[at] == before else f"comes after {before:.6f} s"
        raise table.refuse(
            int(at),
            column.name,
            f"is the time {time[at]:.6f} s, which {what}; times must increase",
            MEND_TIMES[:-1],
        )
    count = int(same.sum())
    return ~same, [f"{count} samples were written twice; each counts once."] if count else []


def _simulated(table: TextTable) -> bool:
    """Test whether a stream is from simulators: a row of its column `simulated` is not 0."""
    return bool(np.any(~np.isin(table.text("simulated"), ("", "0"))))


def _times(table: TextTable, column: Column, *, declared: bool) -> tuple[Array, list[str]]:
    """Return times (n,), s, with a remark if their unit is another one than that of the column.

    Raises
    ------
    DataError
        A cell is no time, or the numbers are in another unit than a map has `declared`.
    """
    if column.unit != DATE:
        return _in_seconds(table, column, declared=declared)
    table.require(column.name, _NAME_THEM)
    found = [seconds_of(str(cell)) for cell in table.text(column.name)]
    for i, seconds in enumerate(found):
        if seconds is None:
            raise table.refuse(
                i, column.name, "is not a date", "Write YYYY-MM-DD HH:MM:SS.fff or MM/DD/YYYY HH:MM:SS.fff"
            )
    return np.array(found, dtype=np.float64), []


def _in_seconds(table: TextTable, column: Column, *, declared: bool) -> tuple[Array, list[str]]:
    table.require(column.name, _NAME_THEM)
    numbers = table.numbers(column.name, required=True)
    low, high = _SINCE_1970
    for unit, name in _UNITS.items():
        known = numbers * TIMES[unit]
        if unit == column.unit or not len(known) or known.min() < low or known.max() > high:
            continue
        if not declared:
            return known, [f"The times of column '{column.name}' are {name} since 1970; they were converted."]
        if numbers[0] * column.factor > _LARGEST:
            raise DataError(
                f"holds {name} since 1970, and [{column.unit}] is declared.",
                do=f"Declare [{unit}] in the map.",
                file=table.path,
                key=column.name,
            )
    whole = len(numbers) > 1 and not np.any(numbers % 1.0)
    if not declared and whole and np.median(np.diff(numbers)) >= _SLOW_S:
        raise DataError(
            f"has whole numbers {np.median(np.diff(numbers)):g} apart, which cannot be seconds.",
            do="Declare their unit in a map of the columns: time=t_s[ms], ...",
            file=table.path,
            key=column.name,
        )
    return _numbers(table, column), []


def _numbers(table: TextTable, column: Column, *, empty: bool = False) -> Array:
    table.require(column.name, _NAME_THEM)
    numbers = table.numbers(column.name, required=not empty)
    for i in np.flatnonzero(np.abs(np.nan_to_num(numbers)) > _LARGEST / column.factor)[:1]:
        raise table.refuse(
            int(i), column.name, f"is {numbers[i]:g}, which is not possible", "Check column and unit"
        )
    return numbers * column.factor


def _refuse_other_unit(joints: Array, columns: Sequence[Column], path: Path) -> None:
    for column, largest in zip(columns, np.max(np.abs(joints), axis=0), strict=True):
        if column.unit == "rad" and largest > _MOST_RAD:
            raise DataError(
                f"holds angles up to {largest:.0f} where rad are declared: these can only be degrees.",
                do="Declare [deg] in the map.",
                file=path,
                key=column.name,
            )
    largest = float(np.max(np.abs(joints))) / DEG
    if all(column.unit == "deg" for column in columns) and largest <= _LARGE_DEG:
        raise DataError(
            f"no joint angle exceeds {largest:.3f}: these can only be radians.",
            do="Declare [rad] in a map, or convert them to degrees.",
            file=path,
            key=columns[0].name,
        )


@dataclass(frozen=True)
class PointExport:
    """n exported points in the order of the file.

    Attributes
    ----------
    names : tuple of str
        `Collection::Group::Point`, or the parts that the file gives.
    points : array of shape (n, 3)
        Points, mm.
    time : array of shape (n,) or None
        Time according to the clock that stamped them, s.
    """

    names: tuple[str, ...]
    points: Array
    time: Array | None


def read_export(path: Path, millimetres: float) -> PointExport:
    """Read an export of points; `millimetres` is the size of its unit in mm.

    Raises
    ------
    DataError
        The file is no such export; the error names file and line.
    """
    names: list[str] = []
    points: list[tuple[float, ...]] = []
    times: list[float | None] = []
    for number, line in enumerate(read_text(path).split("\n"), start=1):
        text = line.strip()
        if not text or text.startswith(_COMMENT):
            continue
        found = _point(text)
        if found is None:
            raise DataError(
                "is not a point: a name, then x, y and z.",
                do="Export Cartesian coordinates, one point per line, names without blanks; comments begin with //.",
                file=path,
                line=number,
            )
        names.append(found[0])
        points.append(found[1])
        times.append(found[2])
        if (found[2] is None) != (times[0] is None):
            raise DataError(
                "has no time stamp where other points have one, or the other way round.",
                do="Export all points in one way.",
                file=path,
                line=number,
            )
    if not points:
        raise DataError("holds no points.", do="Export them again.", file=path)
    stamped = None if times[0] is None else np.array(times, dtype=np.float64)
    return PointExport(tuple(names), np.array(points) * millimetres, stamped)


def _point(text: str) -> tuple[str, tuple[float, ...], float | None] | None:
    """Parse name, coordinates and time of one line; return None if it holds no point."""
    if len(text) > _LONGEST:
        return None
    stamp = STAMP.search(text)
    before = text if stamp is None else text[: stamp.start()]
    fields = [field.strip() for field in before.split(",")] if "," in before else _BLANKS.findall(before)
    values = [_number(field) for field in fields]
    named = max((i + 1 for i, value in enumerate(values[:_MOST_NAMES]) if value is None), default=0)
    # The name of a point may be a number, which has no decimals where coordinates have them.
    while named < _MOST_NAMES and len(values) > named + 3 and fields[named].isdecimal():
        named += 1
    coordinates = [value for value in values[named : named + 3] if value is not None]
    if len(coordinates) < 3:
        return None
    name = "::".join(field.strip('"') for field in fields[:named])
    return name, tuple(coordinates), None if stamp is None else seconds_of(stamp[0])


def _number(text: str) -> float | None:
    try:
        value = float(text.replace("_", "?"))  # Python reads 1_5 as 15
    except ValueError:
        return None
    return value if abs(value) <= _FARTHEST else None
