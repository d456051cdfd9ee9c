"""Reference distances of an arm.

They are found by search instead of by formula, and at many instants of a move instead of over the whole move.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.cell.obstacles import Box, FloorObstacle, Post
from calib.array import Array

_INVERSE_GOLDEN = 0.5 * (5.0**0.5 - 1.0)


def far_from_box(line: Array, low: Sequence[float], high: Sequence[float]) -> float:
    """Calculate the distance between a line (2, 3) and a box, mm, by golden section.

    The distance is convex along the line.
    """

    def far(share: float) -> float:
        place = line[0] + share * (line[1] - line[0])
        return float(np.linalg.norm(place - np.clip(place, low, high)))

    a, b = 0.0, 1.0
    for _ in range(60):
        c, d = b - _INVERSE_GOLDEN * (b - a), a + _INVERSE_GOLDEN * (b - a)
        a, b = (a, d) if far(c) <= far(d) else (c, b)
    return min(far(0.0), far(1.0), far(0.5 * (a + b)))


def far_from_line(line: Sequence[Array], other: Sequence[Array]) -> float:
    """Calculate the distance between two lines, mm, by golden section over projections."""
    u, v = line[1] - line[0], other[1] - other[0]
    best = np.inf
    for share in np.linspace(0.0, 1.0, 101):
        best = min(best, _to_point(line[0] + share * u, other[0], v))
    low, high = 0.0, 1.0
    for _ in range(60):
        c, d = high - _INVERSE_GOLDEN * (high - low), low + _INVERSE_GOLDEN * (high - low)
        if _to_point(line[0] + c * u, other[0], v) <= _to_point(line[0] + d * u, other[0], v):
            high = d
        else:
            low = c
    return min(best, _to_point(line[0] + 0.5 * (low + high) * u, other[0], v))


def _to_point(place: Array, start: Array, along: Array) -> float:
    square = float(along @ along)
    share = 0.0 if square == 0.0 else min(max(float((place - start) @ along) / square, 0.0), 1.0)
    return float(np.linalg.norm(place - start - share * along))


def looked_at(cell: Cell, start: Array, goal: Array, looks: int) -> tuple[float, float]:
    """Return the least distance, mm, over a number of instants of a move.

    The second value is the largest motion of any point between two instants, mm. Points are every few millimetres along
    the capsules; exempted pairs of the cell are left out.
    """
    room = cell.clearance
    share = np.linspace(0.0, 1.0, looks)[:, None]
    lines = room.arm.lines(start + share * (goal - start))
    moved = float(np.linalg.norm(np.diff(lines, axis=0), axis=3).max()) + _COARSE_MM
    along = np.linspace(0.0, 1.0, _POINTS)[:, None]
    nearest = np.inf
    for i, radius in enumerate(room.arm.radii):
        places = lines[:, i, None, 0] + along * (lines[:, i, 1] - lines[:, i, 0])[:, None]
        for obstacle, judged in zip(room.obstacles, room.pairs[i], strict=True):
            if judged:
                nearest = min(nearest, float(_from(obstacle, places).min()) - radius)
    return nearest, moved


_POINTS = 17
_COARSE_MM = 2.0  # by which a point between two of these may be nearer to an edge


def _from(obstacle: object, places: Array) -> Array:
    """Distances in mm from points (..., 3) to a shape; zero or negative inside it."""
    match obstacle:
        case FloorObstacle(z_mm=height):
            return places[..., 2] - height
        case Box(low_mm=low, high_mm=high):
            return np.linalg.norm(places - np.clip(places, low, high), axis=-1)
        case Post(from_mm=start, to_mm=end, radius_mm=radius):
            foot, along = np.array(start), np.subtract(end, start)
            share = np.clip((places - foot) @ along / (along @ along), 0.0, 1.0)
            return np.linalg.norm(places - foot - share[..., None] * along, axis=-1) - radius
    raise AssertionError(obstacle)
