"""The world frame from three nests on the table, and the transform from the tracker's frame into it.

3-2-1: origin in the first nest, x towards the second, z normal to the plane of all three, y = z x x. The same
frame is built from the nests as measured (tracker frame, rotation R_t, origin o_t) and as the cell file has
them (world frame, R_w, o_w); then

    p_world = R_w R_t^T (p_tracker - o_t) + o_w.

Lengths mm. Source: geometric construction; ISO 5459 calls it a datum system of point, line and plane.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from acquisition.errors import NestsDisagree

Array = NDArray[np.float64]


@dataclass(frozen=True)
class WorldFrame:
    """Rotation (3, 3) and origin (3,) mm of the tracker's frame in the world."""

    rotation: Array
    origin: Array

    def to_world(self, points: ArrayLike) -> Array:
        """Tracker frame -> world, (n, 3) or (3,) mm."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.origin

    def to_tracker(self, points: ArrayLike) -> Array:
        """World -> tracker frame, (n, 3) or (3,) mm."""
        return (np.asarray(points, dtype=np.float64) - self.origin) @ self.rotation

    def as_json(self) -> str:
        """Text for the record."""
        return json.dumps({"rotation": self.rotation.tolist(), "origin_mm": self.origin.tolist()})

    @classmethod
    def from_json(cls, text: str) -> WorldFrame:
        """What `as_json` wrote."""
        table = json.loads(text)
        return cls(np.array(table["rotation"]), np.array(table["origin_mm"]))


def frame_of(points: Array) -> tuple[Array, Array]:
    """Rotation (3, 3), columns x, y, z, and origin (3,) of three points (3, 3), one a row.

    Raises ValueError when they lie in a line.
    """
    origin, second, third = points
    x = second - origin
    z = np.cross(x, third - origin)
    if np.linalg.norm(z) < 1e-9 * max(1.0, float(np.linalg.norm(x))) ** 2:
        raise ValueError("three points in a line span no frame")
    x = x / np.linalg.norm(x)
    z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z]).astype(np.float64), origin


def from_nests(
    measured_mm: Mapping[str, ArrayLike], nominal_mm: Mapping[str, ArrayLike], tolerance_mm: float = 1.0
) -> WorldFrame:
    """The transform from the first three nests of `nominal_mm`, each measured in the tracker's frame.

    Raises NestsDisagree when a distance between two of them is off by more than `tolerance_mm`.
    """
    names = list(nominal_mm)[:3]
    tracker = np.array([measured_mm[name] for name in names], dtype=np.float64)
    world = np.array([nominal_mm[name] for name in names], dtype=np.float64)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        found = float(np.linalg.norm(tracker[i] - tracker[j]))
        expected = float(np.linalg.norm(world[i] - world[j]))
        if abs(found - expected) > tolerance_mm:
            raise NestsDisagree(
                f"{names[i]} and {names[j]} are {found:.2f} mm apart, the cell file says {expected:.2f} mm",
                device="instrument",
                command="world frame",
            )
    turn_t, origin_t = frame_of(tracker)
    turn_w, origin_w = frame_of(world)
    rotation = turn_w @ turn_t.T
    return WorldFrame(rotation, origin_w - rotation @ origin_t)
