"""Sizes that numbers of a robot's measurement can have: radians that are called degrees, metres called millimetres."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array import Array
from calib.errors import DataError
from calib.foreign.map.entry import ANGLES, Column
from calib.units import DEG

FEW = 5
"""Rows that can show a size."""
MOST_RAD = 4.0 * np.pi + 1e-3
"""No joint turns further to one side; what does is in degrees."""
LARGE_DEG = 2.0 * np.pi + 1e-3
"""Degrees of which none is larger are radians."""
SMALL_MM, HUGE_MM = 12.0, 100_000.0
"""Points of a robot's measurement span more, and less."""


def refuse_angles(joints: Array, columns: Sequence[Column], file: str) -> None:
    """Raise DataError for joints (n, N), rad, whose columns give them another unit than they can be in."""
    turning = [k for k, column in enumerate(columns) if column.unit in ANGLES]
    if not turning or len(joints) < FEW:
        return
    largest = np.abs(joints[:, turning]).max(axis=0)
    if all(columns[k].unit == "deg" for k in turning) and largest.max() / DEG <= LARGE_DEG:
        raise DataError(
            f"no joint exceeds {largest.max() / DEG:.3f} where degrees are meant: these can only be radians.",
            do="Write [rad] for the joints in the map.",
            file=file,
        )
    for size, k in zip(largest, turning, strict=True):
        if columns[k].unit == "rad" and size > MOST_RAD:
            raise DataError(
                f"column '{columns[k].name}' holds {size:.0f} where radians are meant: these can only be degrees.",
                do="Write [deg] in the map.",
                file=file,
            )


def refuse_points(points: Array, columns: Sequence[Column], file: str) -> None:
    """Raise DataError for points (n, 3), mm, that span what no measurement of a robot does."""
    whole = points[np.isfinite(points).all(axis=1)]
    extent = float(np.ptp(whole, axis=0).max()) if len(whole) >= FEW else 0.0
    if extent and not SMALL_MM <= extent <= HUGE_MM:
        raise DataError(
            f"columns {', '.join(c.name for c in columns)} as {columns[0].unit} span {extent:.4g} mm: no "
            f"robot is measured so.",
            do="Correct the unit in the map: [mm], [m], [in], [um].",
            file=file,
        )
