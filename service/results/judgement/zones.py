"""Zones of the workspace with limits of their own: boxes in the base frame of the robot, named in a file.

    [[zone]]
    name = "left table"
    low_mm = [200.0, -400.0, 0.0]
    high_mm = [500.0, -100.0, 300.0]
    accept_rms_mm = 0.10
    accept_max_mm = 0.25     # either may be left out

A reading belongs to every zone in which the judged model expects its target.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.errors import DataError
from calib.text import TomlTable, read_toml

_KEYS = ("name", "low_mm", "high_mm", "accept_rms_mm", "accept_max_mm")
FARTHEST = 1e5  # mm


@dataclass(frozen=True)
class Zone:
    """A box with edges along the axes of the base frame, and the largest errors in it, mm; None where there is none."""

    name: str
    low: tuple[float, float, float]
    high: tuple[float, float, float]
    rms: float | None
    largest: float | None

    def holds(self, points: Array) -> NDArray[np.bool_]:
        """(n,) which of the points (n, 3), mm, base frame, lie in the box, its faces included."""
        return np.all((points >= self.low) & (points <= self.high), axis=1)

    @property
    def box(self) -> str:
        """Place of the box, in words."""
        spans = (f"{axis} {a:g} to {b:g}" for axis, a, b in zip("xyz", self.low, self.high, strict=True))
        return f"{', '.join(spans)} mm in the base frame"


def read_zones(path: Path) -> tuple[Zone, ...]:
    """The zones of a file. Raises DataError naming file and key."""
    _, values = read_toml(path)
    table = TomlTable(values, path)
    table.only(["zone"])
    zones = tuple(_zone(each) for each in table.tables("zone"))
    if not zones:
        raise DataError("names no zone.", do="Add a [[zone]] table.", file=path, key="zone")
    twice = [zone.name for k, zone in enumerate(zones) if zone.name in {other.name for other in zones[:k]}]
    if twice:
        raise DataError(f"has two zones named {twice[0]!r}.", do="Rename one.", file=path, key="zone.name")
    return zones


def _zone(table: TomlTable) -> Zone:
    table.only(_KEYS)
    name, low, high = table.text("name"), table.vector("low_mm"), table.vector("high_mm")
    if not name.strip():
        raise table.refuse("name", "is empty.", "Name the zone.")
    if not all(a < b for a, b in zip(low, high, strict=True)):
        raise table.refuse(
            "high_mm", "is not above low_mm on every axis.", "Give the two corners of the box."
        )
    limits = [
        table.number(key, low=1e-6, high=FARTHEST) if key in table.values else None
        for key in ("accept_rms_mm", "accept_max_mm")
    ]
    if limits == [None, None]:
        raise table.refuse(
            "accept_rms_mm", "is missing, and so is accept_max_mm.", "Give one of them or both."
        )
    return Zone(name, low, high, *limits)
