"""The obstacles of a cell: convex shapes that arm and tool must not touch.

They are the table, keep-out boxes and fixtures. Every shape answers two questions, batched over straight lines
(p, 2, 3), mm, from end to end. Which point of the shape and which point of the line are nearest to each other? How far
does the shape reach in a direction? The second alone proves that something is clear: no part of a convex shape lies
beyond the plane that touches it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, Protocol, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Discriminator, Tag, model_validator

from acquisition.file_table import Place, Table, Text, refused, told

Array = NDArray[np.float64]
Name = Annotated[Text, told("Name of the fixture, in messages.", "pedestal")]


class Obstacle(Protocol):
    """A convex shape with a name that messages can use."""

    @property
    def name(self) -> str: ...

    def towards(self, lines: Array) -> Array:
        """Compute the vectors from the nearest point of the shape to each line (p, 2, 3).

        The result (p, 3) is in mm, and 0 if they touch.
        """
        ...

    def reach(self, directions: Array) -> Array:
        """Compute how far the shape reaches along unit vectors (p, 3), shape (p,), mm."""
        ...


@dataclass(frozen=True)
class FloorObstacle:
    """Everything below a height."""

    z_mm: float

    @property
    def name(self) -> str:
        return f"the table (table_z_mm = {self.z_mm:g})"

    def towards(self, lines: Array) -> Array:
        out = np.zeros((len(lines), 3))
        out[:, 2] = np.maximum(lines[:, :, 2].min(axis=1) - self.z_mm, 0.0)
        return out

    def reach(self, directions: Array) -> Array:
        return np.where(directions[:, 2] > 1.0 - 1e-12, self.z_mm, np.inf)


class Box(Table):
    """A box along the axes of the world."""

    name: Name
    low_mm: Annotated[Place, told("The lower one of two opposite corners, mm.", [-150.0, -150.0, -600.0])]
    high_mm: Annotated[Place, told("The upper corner, mm.", [150.0, 150.0, 0.0])]

    @model_validator(mode="after")
    def _is_a_box(self) -> Self:
        if not np.less(self.low_mm, self.high_mm).all():
            what, do = "is not above low_mm in x, y and z.", "Give two opposite corners."
            raise refused("high_mm", what, do)
        return self

    def towards(self, lines: Array) -> Array:
        """Compute the vectors from the nearest point of the box to each line.

        The square of the distance is convex along a line and quadratic between the planes of the box's faces. Its slope
        is therefore evaluated where the line crosses these planes; the least distance lies where it changes its sign,
        between two of them.
        """
        low, high = np.array(self.low_mm), np.array(self.high_mm)
        start, along = lines[:, 0], lines[:, 1] - lines[:, 0]
        still = np.abs(along) < 1e-12
        step = np.where(still, 1.0, along)
        crossed = np.concatenate([(low - start) / step, (high - start) / step], axis=1)
        crossed[np.concatenate([still, still], axis=1)] = 0.0
        share = np.sort(np.clip(crossed, 0.0, 1.0), axis=1)
        share = np.concatenate([np.zeros((len(lines), 1)), share, np.ones((len(lines), 1))], axis=1)
        points = start[:, None] + share[:, :, None] * along[:, None]
        off = points - np.clip(points, low, high)
        slope = np.einsum("pkj,pj->pk", off, along)
        after = np.clip(np.sum(slope < 0.0, axis=1), 1, share.shape[1] - 1)[:, None]
        (t0, t1), (s0, s1) = (
            [np.take_along_axis(of, after - i, axis=1)[:, 0] for i in (1, 0)] for of in (share, slope)
        )
        rise = s1 - s0
        best = t0 + (t1 - t0) * np.clip(-s0 / np.where(rise > 0.0, rise, 1.0), 0.0, 1.0)
        nearest = start + best[:, None] * along
        return nearest - np.clip(nearest, low, high)

    def reach(self, directions: Array) -> Array:
        return np.sum(np.where(directions > 0.0, self.high_mm, self.low_mm) * directions, axis=1)


class Post(Table):
    """A straight bar or post of any direction with round ends.

    It contains all points within `radius_mm` of a line.
    """

    name: Name
    from_mm: Annotated[Place, told("One end of a post, mm.", [380.0, 80.0, 0.0])]
    to_mm: Annotated[Place, told("The other end, mm.", [380.0, 80.0, 600.0])]
    radius_mm: Annotated[float, told("Radius of the post, mm.", 50.0, ge=0.1, le=10_000.0)]

    def towards(self, lines: Array) -> Array:
        axis = np.array([self.from_mm, self.to_mm])
        apart = between_lines(lines, np.broadcast_to(axis, lines.shape))
        length = np.linalg.norm(apart, axis=1, keepdims=True)
        return apart * np.maximum(1.0 - self.radius_mm / np.maximum(length, 1e-12), 0.0)

    def reach(self, directions: Array) -> Array:
        ends = directions @ np.array([self.from_mm, self.to_mm]).T
        return ends.max(axis=1) + self.radius_mm


def between_lines(lines: Array, others: Array) -> Array:
    """Compute the shortest vectors (p, 3), mm, from `others` to `lines`, both (p, 2, 3).

    Source: Ericson, Real-Time Collision Detection (2005), 5.1.9.
    """
    u, v = lines[:, 1] - lines[:, 0], others[:, 1] - others[:, 0]
    r = lines[:, 0] - others[:, 0]
    uu, vv, uv = (np.sum(a * b, axis=1) for a, b in ((u, u), (v, v), (u, v)))
    ur, vr = np.sum(u * r, axis=1), np.sum(v * r, axis=1)
    determinant = uu * vv - uv * uv
    skew = determinant > 1e-12 * uu * vv
    s = np.where(skew, (uv * vr - ur * vv) / np.where(skew, determinant, 1.0), 0.0)
    s = np.clip(s, 0.0, 1.0)
    t = np.clip((uv * s + vr) / np.where(vv > 0.0, vv, 1.0), 0.0, 1.0)
    s = np.clip((uv * t - ur) / np.where(uu > 0.0, uu, 1.0), 0.0, 1.0)
    return r + s[:, None] * u - t[:, None] * v


def _shape(values: Any) -> str:
    given = values.keys() if isinstance(values, Mapping) else ()
    return "Box" if "low_mm" in given or "high_mm" in given else "Post"


Fixture = Annotated[Annotated[Box, Tag("Box")] | Annotated[Post, Tag("Post")], Discriminator(_shape)]
"""An obstacle of a cell file: a box if it has a corner, otherwise a post."""
