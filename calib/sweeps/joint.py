"""Single joints: tangential error over its angle, lost motion between its two directions, and its axis.

While joint k alone turns, a target runs on a circle. The tangential error of a reading is the angle at which the
target lies on that circle minus the commanded one. The range of its mean over both directions is the error range of
the joint. The difference of the readings on the way up and on the way down is its reversal value: positive where the
joint comes to rest beyond its target, negative where it stops short. Both contain the deflection of the other joints
under gravity. Source: Nubiola 2.4.1 and Figures 2.10 to 2.15; ISO 230-2 (reversal value).

The circle through the points of a sweep, fitted so that the joint's own error does not distort it.

Fitted to commanded angles alone, the circle takes a part of the joint's error for a place of its centre: over half a
turn an error of three waves grows by half. Fitted to distances from plane and circle alone, a short arc leaves its
centre open. So both are fitted, each weighted by the scatter that it leaves: a joint without error lends its angles
in full, one that errs much keeps its angles out. The two directions of the sweep have an angle of their own.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.fit.circle_points import FEWEST, LEAST_RANGE, CircleSweep, find_sweeps, fit_axes
from calib.fit.identification import IdentificationFit
from calib.model.model import BoundModel
from calib.units import DEG

_SAME = 1e-3 * DEG  # commanded angles of one place
_ROUNDS = 6
_HELD = 1e-9  # keeps the angle of a direction in which nothing was measured


@dataclass(frozen=True)
class AxisDifference:
    """The distance of the axis of a circle from the same axis of an identified arm.

    angle: rad between the directions; distance: mm from the centre of the circle to the identified axis;
    u_angle, u_distance: standard uncertainties of the circle's part alone.
    """

    angle: float
    u_angle: float
    distance: float
    u_distance: float


@dataclass(frozen=True)
class JointSweep:
    """The result of a sweep of n readings at p places.

    angle, tangential: (n,) rad; radial: (n,) mm outside the circle; upwards: (n,); joint: 1-based; places: (p,)
    rad, the commanded angles, ascending; error: (p,) rad, the tangential error there without the reversal; reversal:
    rad, up less down, with its standard uncertainty u_reversal; None where no place, or only one, was reached in both
    directions.
    """

    joint: int
    series: str
    target: str
    radius: float
    angle: Array
    tangential: Array
    radial: Array
    upwards: NDArray[np.bool_]
    places: Array
    error: Array
    reversal: float | None
    u_reversal: float | None
    axis: AxisDifference | None

    @property
    def error_range(self) -> float:
        """Largest less smallest error of a place, rad."""
        return float(np.ptp(self.error))


def analyse(dataset: Dataset, identified: IdentificationFit | None = None) -> tuple[JointSweep, ...]:
    """Every sweep of the calibration readings, by joint. Raises DataError where there is none.

    identified: an arm with which the axes are compared; its base is that of the same data set.
    """
    of_one = (_of_one_pattern(dataset, sweep) for sweep in find_sweeps(dataset))
    sweeps = [sweep for sweep in of_one if _is_one_still(dataset, sweep)]
    sweeps.sort(key=lambda sweep: (sweep.series, sweep.joint, sweep.target))
    if not sweeps:
        raise DataError(
            f"holds no sweep: {FEWEST} readings of one target in which one joint alone turns, over "
            f"{LEAST_RANGE / DEG:.0f} deg, while the others came from the same sides.",
            do='Measure one with `kind = "sweep"` in a campaign.',
            file=dataset.name,
        )
    return tuple(_analysed(dataset, sweep, identified) for sweep in sweeps)


def _of_one_pattern(dataset: Dataset, sweep: CircleSweep) -> CircleSweep:
    """The readings in which all other joints came from the sides that most of them share: their backlash rests."""
    others = np.delete(dataset.conditions.side[sweep.rows], sweep.joint - 1, axis=1)
    _, pattern, count = np.unique(others, axis=0, return_inverse=True, return_counts=True)
    return replace(sweep, rows=sweep.rows[pattern.reshape(-1) == int(np.argmax(count))])


def _is_one_still(dataset: Dataset, sweep: CircleSweep) -> bool:
    """Whether the readings that are left are enough for a sweep."""
    angle = dataset.conditions.joints[sweep.rows, sweep.joint - 1]
    return len(angle) >= FEWEST and bool(np.ptp(angle) >= LEAST_RANGE)


def _analysed(dataset: Dataset, sweep: CircleSweep, identified: IdentificationFit | None) -> JointSweep:
    conditions = dataset.conditions
    angle = conditions.joints[sweep.rows, sweep.joint - 1]
    upwards = conditions.side[sweep.rows, sweep.joint - 1] > 0
    circle = fit_circle(dataset.points[sweep.rows], angle, upwards)
    seen, radial = circle.place(dataset.points[sweep.rows])
    tangential = np.angle(np.exp(1j * (seen - angle)))
    tangential = np.angle(np.exp(1j * (tangential - np.angle(np.exp(1j * tangential).sum()))))
    number, places = _places(angle)
    gaps = _mean(tangential, number, upwards) - _mean(tangential, number, ~upwards)
    gaps = gaps[np.isfinite(gaps)]
    reversal = float(gaps.mean()) if len(gaps) else None
    without = tangential - 0.5 * (reversal or 0.0) * np.where(upwards, 1.0, -1.0)
    error = _mean(without, number, np.ones(len(angle), dtype=bool))
    return JointSweep(
        joint=sweep.joint,
        series=conditions.series_names[sweep.series],
        target=conditions.target_names[sweep.target],
        radius=circle.radius,
        angle=angle,
        tangential=tangential,
        radial=radial,
        upwards=upwards,
        places=places,
        error=error,
        reversal=reversal,
        u_reversal=float(gaps.std(ddof=1) / np.sqrt(len(gaps))) if len(gaps) > 1 else None,
        axis=None if identified is None else _difference(dataset, sweep, circle, identified),
    )


def _places(angle: Array) -> tuple[NDArray[np.int64], Array]:
    """Number of the place of every commanded angle (n,), and the angle of each place (p,), ascending."""
    rounded, number = np.unique(np.round(angle / _SAME).astype(np.int64), return_inverse=True)
    return number.reshape(-1).astype(np.int64), _SAME * rounded.astype(np.float64)


def _mean(values: Array, number: NDArray[np.int64], rows: NDArray[np.bool_]) -> Array:
    """(p,) mean of the values (n,) of some rows at every place; NaN where none of them is."""
    places = int(number.max()) + 1
    count = np.bincount(number[rows], minlength=places)
    total = np.bincount(number[rows], weights=values[rows], minlength=places)
    return np.divide(total, count, out=np.full(places, np.nan), where=count > 0)


def _difference(
    dataset: Dataset, sweep: CircleSweep, circle: Circle, identified: IdentificationFit
) -> AxisDifference:
    """The identified axis, averaged over the sweep: where gravity bends the arm it moves a little."""
    slot = f"theta{sweep.joint}"
    design = BoundModel(identified.model, dataset.conditions.take(sweep.rows))
    frames = design.frames(identified.estimate, record=[slot])
    direction, point = frames.axis[slot].mean(axis=1), frames.origin[slot].mean(axis=1)
    direction = direction / np.linalg.norm(direction)
    across = np.cross(direction, circle.centre - point)
    return AxisDifference(
        angle=float(
            np.arctan2(np.linalg.norm(np.cross(direction, circle.direction)), direction @ circle.direction)
        ),
        u_angle=circle.u_direction,
        distance=float(np.linalg.norm(across)),
        u_distance=circle.u_centre,
    )


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
