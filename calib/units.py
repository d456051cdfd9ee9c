"""Units at the border: inside the program rad, mm, N.mm, s, degC; in files and on screens the units below.

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
    """Internal value -> value in `unit`. Raises KeyError for a unit that the table does not hold."""
    return value / FACTORS[unit]


def to_internal(value: float, unit: str) -> float:
    """Value in `unit` -> internal value. Raises KeyError for a unit that the table does not hold."""
    return value * FACTORS[unit]
