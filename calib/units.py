"""Conversion between internal and displayed units.

Internal units are rad, mm, N.mm, s and degC. Files and screens use the units below.

`FACTORS[unit]` converts one displayed unit to internal units: internal = displayed x factor.
"""

from __future__ import annotations

import math

DEG = math.pi / 180.0

FACTORS: dict[str, float] = {
    "": 1.0,
    "mm": 1.0,
    "deg": DEG,
    "mrad": 1e-3,
    "ppm": 1e-6,
    "1e-6/K": 1e-6,
    "deg/K": DEG,
    "1e-6 rad/(N.mm)": 1e-6,
    "1e-6 rad/(N.m)": 1e-9,
    "1e-15 rad/(N.mm)^3": 1e-15,
    "um/N": 1e-3,
    "mm/h": 1.0 / 3600.0,
    "deg/h": DEG / 3600.0,
    "kg": 1.0,
}


def to_display(value: float, unit: str) -> float:
    """Convert an internal value to `unit`.

    Raises
    ------
    KeyError
        `FACTORS` does not have the unit.
    """
    return value / FACTORS[unit]


def to_internal(value: float, unit: str) -> float:
    """Convert a value in `unit` to internal units.

    Raises
    ------
    KeyError
        `FACTORS` does not have the unit.
    """
    return value * FACTORS[unit]


def percent(share: float, digits: int = 0) -> str:
    """Format a share in percent, with a no-break space, for sentences and tables only.

    >>> percent(0.953, 1)
    '95.3\\xa0%'
    """
    return f"{100.0 * share:.{digits}f}\u00a0%"
