"""Conditions of the readings, on which effects depend, as arrays over n readings.

Joints are those of the model (behind the joint matrix), rad, or mm for one that slides. Times are in s,
temperatures in degC, torques and moments in N.mm, forces along a slide in N. A quantity that was not
recorded is NaN; effects that need it are then not offered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.units import DEG

_SAME_POSE = 1e-4 * DEG


@dataclass(frozen=True)
class Conditions:
    """Conditions of n readings of a robot with N joints."""

    joints: Array  # (n, N) commanded
    previous: Array  # (n, N) where the robot was before
    earlier: Array  # (n, N) the move before the last, rad or mm; 0 where a series begins
    side: Array  # (n, N) +1 when the joint arrived from below, -1 from above
    torque: Array  # (n, N) gravity torque, nominal geometry; this and the next three: see kinematics.Statics
    moment: Array  # (n, N, 3) gravity moment at every joint, axes of the frame just before it turns
    overturning: Array  # (n, 3) gravity moment of the whole arm about the base's origin, axes of the base
    unit_load: Array  # (n, N, 4) torques of 1 kg, and of 1 kg mm along x, y, z, on the last link
    time: Array  # (n,)
    order: Array  # (n,) rank of the reading in its campaign, 0, 1, ...
    temperature: Array  # (n,) air
    point: Array  # (n, 3) where the nominal robot in its place holds the target, mm, world
    series: NDArray[np.int64]  # (n,) index into series_names
    target: NDArray[np.int64]  # (n,) index into target_names
    anchor: NDArray[np.int64]  # (n,) index into anchor_names of the base target of a distance; -1: none
    waypoint: NDArray[np.int64]  # (n,) number of the pose where the file numbers them; -1: not numbered
    visit: NDArray[np.int64]  # (n,) the same for readings between which the robot stood still
    series_names: tuple[str, ...]
    target_names: tuple[str, ...]
    anchor_names: tuple[str, ...] = ()
    axis_names: tuple[str, ...] = ()  # what the joints are called, "e1"; empty: j1, j2, ...
    unit_names: tuple[str, ...] = ()  # in which they are read, "deg" or "mm"; empty: all deg

    def __len__(self) -> int:
        return len(self.joints)

    @cached_property
    def pose(self) -> NDArray[np.int64]:
        """Number of the pose of every reading, shape (n,), independent of time and arrival.

        Readings of one waypoint share their pose, since joints that were interpolated between two
        samples differ from visit to visit. Readings without a waypoint share it if their joints are the
        same.
        """
        places = np.round(self.joints / _SAME_POSE).astype(np.int64)
        places[self.waypoint >= 0] = 0
        keys = np.column_stack([self.waypoint, places])
        return numbered(keys)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64] | Sequence[int]) -> Conditions:
        """Select readings by mask or index; return the object itself if the mask selects all."""
        if isinstance(rows, np.ndarray) and rows.dtype == np.bool_ and rows.all():
            return self
        arrays = {f.name: getattr(self, f.name)[rows] for f in fields(self) if not f.name.endswith("_names")}
        return replace(self, **arrays)


def numbered(keys: NDArray[np.int64]) -> NDArray[np.int64]:
    """Number the rows of keys (n, c), shape (n,); equal rows get the same number.

    The numbers follow the order of the rows. They equal those of `numpy.unique`, but are several times
    faster.
    """
    order = np.lexsort(keys.T[::-1])
    in_order = keys[order]
    number = np.empty(len(keys), dtype=np.int64)
    number[order] = np.cumsum(np.append(False, (in_order[1:] != in_order[:-1]).any(axis=1))[: len(keys)])
    return number


def row_keys(columns: Array) -> list[bytes]:
    """Return a key for each row of columns (n, c).

    Rows with exactly the same numbers have the same key.
    """
    numbers = np.ascontiguousarray(columns + 0.0)  # -0 becomes 0
    return numbers.view(f"V{numbers.itemsize * numbers.shape[1]}").ravel().tolist()
