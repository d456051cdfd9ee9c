"""Point exports in the style of SpatialAnalyzer: one point a line, its name, its coordinates, perhaps a time stamp.

    // SpatialAnalyzer ...                                  comments: version, frame, axes, format
    Path::Tool::p1, 1234.567, 89.012, -345.678, 11/22/2026 08:15:30.125

Names come whole (`Collection::Group::Point`), in up to three fields (collection, group, point) or not at all; fields
are separated by commas, tabs or blanks. The file does not say its unit. What follows the coordinates, other than a
time stamp, is left: offsets, tolerances, uncertainties, comments. Only Cartesian coordinates are read. Written from
the maker's manual (SA User Manual, "Exporting ASCII Formatted Points"), not tried on a file of every version.
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calib.array import Array
from calib.errors import DataError
from calib.foreign.files.dates import STAMP, seconds_of
from calib.text.text_file import read_text

_COMMENT = ("//", "#")
_MOST_NAMES = 3
_BLANKS = re.compile(r'"[^"]*"|[^\s,]+')
_LONGEST = 10_000
_FARTHEST = 1e8  # units: what is beyond is no coordinate


@dataclass(frozen=True)
class Export:
    """n points in the order of the file: names (n,) `Collection::Group::Point` as far as given, points (n, 3) mm, and
    time (n,) s by the clock that stamped them, or None."""

    names: tuple[str, ...]
    points: Array
    time: Array | None


def read_export(path: Path, millimetres: float) -> Export:
    """An export whose coordinates are in units of so many mm. Raises DataError (file, line) for what is none."""
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
                "is no point: a name, then x, y and z.",
                do="Export Cartesian coordinates, one point a line, names without blanks; comments begin with //.",
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
    return Export(tuple(names), np.array(points) * millimetres, stamped)


def _point(text: str) -> tuple[str, tuple[float, ...], float | None] | None:
    """Name, coordinates and time of one line; None where it holds no point."""
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
