"""Entries of a map of columns, and the sizes that numbers of a measurement can have.

An entry assigns a quantity to a column of a foreign file and the unit of its numbers, `Timestamp[ms]`.
The map of a recording is one line with commas: `time=Timestamp[ms], j1=actual_q_0[rad], ...`. The map of
a measured file is a separate file (`calib.foreign.map.map_file`). A time with the unit `date`
is a date and a time of day.

The sizes reveal wrong units: radians that are called degrees, metres called millimetres.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.errors import DataError
from calib.units import DEG

DATE = "date"
ANGLES = {"deg": DEG, "rad": 1.0, "mrad": 1e-3, "gon": 0.9 * DEG}
LENGTHS = {"mm": 1.0, "m": 1000.0, "um": 1e-3, "cm": 10.0, "in": 25.4}
TIMES = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9, "min": 60.0, DATE: 1.0}
TEMPERATURES = {"c": 1.0}
_ENTRY = re.compile(r"(\w++)\s*+=\s*+(\S.*)\[\s*+(\w++)\s*+\]")
_COLUMN = re.compile(r"(\S.*)\[\s*+(\w++)\s*+\]")
FEW = 5
"""Rows that can show a size."""

MOST_RAD = 4.0 * np.pi + 1e-3
"""No joint turns further to one side; what does is in degrees."""

LARGE_DEG = 2.0 * np.pi + 1e-3
"""Degrees of which none is larger are radians."""

SMALL_MM, HUGE_MM = 12.0, 100_000.0
"""Points of a robot's measurement span more, and less."""


@dataclass(frozen=True)
class Column:
    """A column of a file, the unit of its numbers, and the factor to internal units."""

    name: str
    unit: str
    factor: float


def units_of(quantity: str) -> Mapping[str, float]:
    """Return the units that a quantity may have, with their factors to rad, mm, s or degC."""
    if quantity == "time":
        return TIMES
    if quantity == "t_air":
        return TEMPERATURES
    if quantity.startswith("rot_"):
        return ANGLES
    return (
        {**ANGLES, **LENGTHS} if quantity.startswith(("j", "e", "read", "prev")) else LENGTHS
    )  # a joint may slide


def column_of(text: str, quantity: str, key: str, file: str | None = None) -> Column:
    """Parse the column `name[unit]` of a quantity.

    Raises
    ------
    DataError
        The text cannot be read, or the quantity cannot have this unit; the error names file and key.
    """
    match = _COLUMN.fullmatch(text.strip())
    if match is None:
        raise DataError(
            f"{text.strip()[:100]!r} cannot be read.",
            do="Write the name of the column and the unit of its numbers, e.g. X_meas[mm].",
            file=file,
            key=key,
        )
    name, unit = match.groups()
    known = units_of(quantity)
    if unit not in known:
        raise DataError(
            f"gives {quantity} the unit '{unit}'.", do=f"Use {', '.join(known)}.", file=file, key=key
        )
    return Column(name.strip(), unit, known[unit])


def parse_map(text: str, quantities: Sequence[str], key: str) -> dict[str, Column]:
    """Parse a map in one line to columns by quantity.

    Raises
    ------
    DataError
        The map cannot be read, or does not name every quantity once; the error names the key.
    """
    found: dict[str, Column] = {}
    names = f"Name {', '.join(quantities)}, each once."
    for part in re.split(r"(?<=\])\s*+,", text):
        match = _ENTRY.fullmatch(part.strip())
        if match is None:
            raise DataError(
                f"{part.strip()[:100]!r} cannot be read.",
                do="Write quantity=column[unit], e.g. time=Timestamp[ms].",
                key=key,
            )
        quantity, name, unit = match.groups()
        if quantity.startswith("j") and unit not in ANGLES:  # joints of a stream turn
            raise DataError(f"gives {quantity} the unit '{unit}'.", do=f"Use {', '.join(ANGLES)}.", key=key)
        if quantity not in quantities or quantity in found:
            raise DataError(f"names '{quantity}'.", do=names, key=key)
        found[quantity] = column_of(f"{name}[{unit}]", quantity, key)
    for quantity in quantities:
        if quantity not in found:
            raise DataError(f"does not name '{quantity}'.", do=names, key=key)
    return found


def refuse_angles(joints: Array, columns: Sequence[Column], file: str) -> None:
    """Raise DataError for joints (n, N), rad, whose size contradicts the unit of their columns."""
    turning = [k for k, column in enumerate(columns) if column.unit in ANGLES]
    if not turning or len(joints) < FEW:
        return
    largest = np.abs(joints[:, turning]).max(axis=0)
    if all(columns[k].unit == "deg" for k in turning) and largest.max() / DEG <= LARGE_DEG:
        raise DataError(
            f"no joint exceeds {largest.max() / DEG:.3f}, but the map says degrees: these can only be radians.",
            do="Write [rad] for the joints in the map.",
            file=file,
        )
    for size, k in zip(largest, turning, strict=True):
        if columns[k].unit == "rad" and size > MOST_RAD:
            raise DataError(
                f"column '{columns[k].name}' holds {size:.0f}, but the map says radians: these can only be degrees.",
                do="Write [deg] in the map.",
                file=file,
            )


def refuse_points(points: Array, columns: Sequence[Column], file: str) -> None:
    """Raise DataError for points (n, 3), mm, that span what no measurement of a robot does."""
    whole = points[np.isfinite(points).all(axis=1)]
    extent = float(np.ptp(whole, axis=0).max()) if len(whole) >= FEW else 0.0
    if extent and not SMALL_MM <= extent <= HUGE_MM:
        raise DataError(
            f"columns {', '.join(c.name for c in columns)} as {columns[0].unit} span {extent:.4g} mm, "
            "which cannot be measured points of a robot.",
            do="Correct the unit in the map: [mm], [m], [in], [um].",
            file=file,
        )
