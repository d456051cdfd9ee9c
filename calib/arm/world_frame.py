"""World frame from nests on a table, or from base cups that robot and ballbar have measured.

A 3-2-1 frame has its origin in the first point, x towards the second, z normal to the plane of all
three, and y = z x x. ISO 5459 calls it a datum system of point, line and plane. The frame may instead be
fitted to three nests or more, which spreads their errors and shows them.

Points that a robot has touched carry its errors. The correction keeps their mean position and
orientation, and gives the triangle the sides that the ballbar read. Lengths are in mm. Sources: Kabsch
1976, Nubiola, section 4.2, (4.10)-(4.12).
"""

from __future__ import annotations

import json
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from calib.arm.start import align
from calib.array import Array
from calib.errors import DataError


@dataclass(frozen=True)
class WorldFrame:
    """Rotation (3, 3) and origin (3,) mm of another frame, the instrument's, in the world."""

    rotation: Array
    origin: Array

    def to_world(self, points: ArrayLike) -> Array:
        """Instrument's frame -> world, (n, 3) or (3,) mm."""
        return np.asarray(points, dtype=np.float64) @ self.rotation.T + self.origin

    def to_tracker(self, points: ArrayLike) -> Array:
        """World -> instrument's frame, (n, 3) or (3,) mm."""
        return (np.asarray(points, dtype=np.float64) - self.origin) @ self.rotation

    def turned_to_world(self, rot_wxyz: ArrayLike) -> Array:
        """Convert unit quaternions of rotations from the instrument's frame to the world.

        They are (n, 4) or (4,), scalar first; the scalar of the result is not negative.
        """
        turn = Rotation.from_matrix(self.rotation) * Rotation.from_quat(rot_wxyz, scalar_first=True)
        return turn.as_quat(canonical=True, scalar_first=True)

    def as_json(self) -> str:
        """Write the frame as text for the record."""
        return json.dumps({"rotation": self.rotation.tolist(), "origin_mm": self.origin.tolist()})

    @classmethod
    def from_json(cls, text: str) -> WorldFrame:
        """Read what `as_json` wrote."""
        table = json.loads(text)
        return cls(np.array(table["rotation"]), np.array(table["origin_mm"]))


def frame_of(points: Array) -> tuple[Array, Array]:
    """Build the frame of three points (3, 3), one per row.

    Returns the rotation (3, 3), whose columns are x, y, z, and the origin (3,).

    Raises
    ------
    ValueError
        The points lie in a line.
    """
    origin, second, third = points
    x = second - origin
    z = np.cross(x, third - origin)
    if np.linalg.norm(z) < 1e-9 * max(1.0, float(np.linalg.norm(x))) ** 2:
        raise ValueError("three points in a line span no frame")
    x = x / np.linalg.norm(x)
    z = z / np.linalg.norm(z)
    return np.column_stack([x, np.cross(z, x), z]).astype(np.float64), origin


def by_three_two_one(measured: Array, nominal: Array) -> WorldFrame:
    """Find the transform of the frame of three measured points to that of three nominal ones.

    Both are (3, 3), mm. Errors of the second point along x, and of the third within the plane, do not
    turn it.

    Raises
    ------
    ValueError
        Three points lie in a line.
    """
    turn_measured, origin_measured = frame_of(measured)
    turn_nominal, origin_nominal = frame_of(nominal)
    rotation = turn_nominal @ turn_measured.T
    return WorldFrame(rotation, origin_nominal - rotation @ origin_measured)


def fitted(measured: Array, nominal: Array) -> tuple[WorldFrame, Array]:
    """Fit the transform that brings n >= 3 measured points closest to nominal ones.

    `measured` and `nominal` are (n, 3), mm. Returns the transform and the residuals (n, 3), mm.

    Raises
    ------
    DataError
        There are fewer than three points, or all lie in a line, so that the turn about it is undetermined.
    """
    spread = (
        np.linalg.svd(nominal - nominal.mean(axis=0), compute_uv=False) if len(nominal) >= 3 else np.zeros(3)
    )
    if spread[1] <= 1e-9 * max(1.0, spread[0]):
        raise DataError(
            f"{len(nominal)} nests that lie in a line, or are too few, span no frame.",
            do="Measure three or more, well apart, that do not lie in a line.",
        )
    rotation, translation = align(measured, nominal, np.ones(len(nominal)))
    frame = WorldFrame(rotation, translation)
    return frame, frame.to_world(measured) - nominal


@dataclass(frozen=True)
class Triangle:
    """Three points (3, 2) with the measured sides, laid over the points that were touched.

    Relative to its own corner and first side, the triangle has been turned by `angle`, rad, and shifted
    by `shift` (2,), mm.
    """

    points: Array
    shift: Array
    angle: float


def corrected_triangle(touched: Array, sides: ArrayLike) -> Triangle:
    """Fit the triangle of given sides to three touched points in the plane.

    `touched` is (3, 2), mm; `sides` are d12, d23, d31.

    Raises
    ------
    DataError
        The sides make no triangle.
    """
    d12, d23, d31 = np.asarray(sides, dtype=np.float64)
    u = (d12**2 + d31**2 - d23**2) / (2.0 * d12) if d12 > 0.0 else np.inf
    if not abs(u) < d31:
        raise DataError(
            f"lengths of {d12:g}, {d23:g} and {d31:g} mm make no triangle.",
            do="Measure the distances of the base cups again.",
            key="d12, d23, d31",
        )
    own = np.array([[0.0, 0.0], [d12, 0.0], [u, np.sqrt(d31**2 - u**2)]])
    s, p = own - own.mean(axis=0), touched - touched.mean(axis=0)
    angle = float(np.arctan2(np.sum(s[:, 0] * p[:, 1] - s[:, 1] * p[:, 0]), np.sum(s * p)))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    shift = touched.mean(axis=0) - turn @ own.mean(axis=0)
    return Triangle(own @ turn.T + shift, shift, angle)


def of_base_points(touched: Array, sides: ArrayLike) -> WorldFrame:
    """Build the robot's working frame in the world of three base points.

    The origin is the first point, x points to the second, z is normal to the plane.

    Parameters
    ----------
    touched : array of shape (3, 3)
        Points as the robot has them, mm, counter-clockwise from above.
    sides : array of shape (3,)
        d12, d23, d31 as the ballbar has them, mm.

    Raises
    ------
    ValueError
        The points lie in a line.
    DataError
        The sides make no triangle.
    """
    rotation, corner = frame_of(with_sides(touched, sides))
    return WorldFrame(rotation.T, -corner @ rotation)


def with_sides(touched: Array, sides: ArrayLike) -> Array:
    """Move three touched points within their plane so that they have the measured sides.

    `sides` are d12, d23, d31, mm; the result has the shape (3, 3).

    Raises
    ------
    ValueError
        The points lie in a line.
    DataError
        The sides make no triangle.
    """
    turn, origin = frame_of(touched)
    flat = (touched - origin) @ turn
    points = corrected_triangle(flat[:, :2], sides).points
    return np.column_stack([points, np.zeros(3)]) @ turn.T + origin
