"""The circle through the points of a sweep, fitted so that the joint's own error does not distort it.

Fitted to commanded angles alone, the circle takes a part of the joint's error for a place of its centre: over half a
turn an error of three waves grows by half. Fitted to distances from plane and circle alone, a short arc leaves its
centre open. So both are fitted, each weighted by the scatter that it leaves: a joint without error lends its angles
in full, one that errs much keeps its angles out. The two directions of the sweep have an angle of their own.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.fit.circle_points import fit_axes

_ROUNDS = 6
_HELD = 1e-9  # keeps the angle of a direction in which nothing was measured


@dataclass(frozen=True)
class Circle:
    """A circle in space: direction (3,) of its axis by the right hand, centre (3,) mm, radius mm.

    cosine, sine: (3,) directions from which and towards which angles count; u_direction: rad, standard uncertainty of
    the direction; u_centre: mm, that of the centre in its plane.
    """

    direction: Array
    centre: Array
    radius: float
    cosine: Array
    sine: Array
    u_direction: float
    u_centre: float

    def place(self, points: Array) -> tuple[Array, Array]:
        """Angle, rad, and distance outside the circle, mm, of points (n, 3): both (n,)."""
        away = points - self.centre
        x, y = away @ self.cosine, away @ self.sine
        return np.arctan2(y, x), np.hypot(x, y) - self.radius


def fit_circle(points: Array, angle: Array, upwards: NDArray[np.bool_]) -> Circle:
    """The circle of points (n, 3), mm, at commanded angles (n,), rad, reached upwards or not (n,)."""
    start = fit_axes(points[None], angle[None], np.ones((1, len(angle)), dtype=bool))
    middle = points.mean(axis=0)
    _, sizes, axes = np.linalg.svd(points - middle, full_matrices=False)
    direction = axes[2] * np.sign(axes[2] @ start.direction[0])
    flat = sizes[2] / np.sqrt(max(len(points) - 3, 1))
    cosine = start.cosine[0] - direction * (direction @ start.cosine[0])
    cosine /= np.linalg.norm(cosine)
    plane = np.column_stack([cosine, np.cross(direction, cosine)])
    at = (points - middle) @ plane
    # centre in the plane, radius, and the angles from which upward and downward readings count
    found = np.array([*(start.centre[0] - middle) @ plane, np.linalg.norm(start.cosine[0]), 0.0, 0.0])
    weight = np.ones(2)
    normal = np.eye(5)
    for _ in range(_ROUNDS):
        radius, turned = found[2], angle + np.where(upwards, found[3], found[4])
        outward = np.stack([np.cos(turned), np.sin(turned)])
        along = np.stack([-np.sin(turned), np.cos(turned)])
        off = at.T - found[:2, None] - radius * outward
        none, one = np.zeros(len(angle)), np.ones(len(angle))
        across = np.stack([*outward, one, none, none])
        tangent = np.stack([*along, none, radius * upwards, radius * ~upwards])
        radial, tangential = np.sum(off * outward, axis=0), np.sum(off * along, axis=0)
        normal = weight[0] * across @ across.T + weight[1] * tangent @ tangent.T + _HELD * np.eye(5)
        found = found + np.linalg.solve(
            normal, weight[0] * across @ radial + weight[1] * tangent @ tangential
        )
        freedom = max(len(angle) - 3, 1)
        scatter = np.array([radial @ radial, tangential @ tangential]) / freedom
        weight = 1.0 / np.maximum(scatter, max(scatter.max() * 1e-6, 1e-18))
    spread = np.linalg.inv(normal)
    return Circle(
        direction,
        middle + plane @ found[:2],
        float(found[2]),
        plane[:, 0],
        plane[:, 1],
        u_direction=float(flat * np.hypot(1.0 / sizes[0], 1.0 / sizes[1])),
        u_centre=float(np.sqrt(spread[0, 0] + spread[1, 1])),
    )
