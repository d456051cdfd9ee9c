"""Sweeps of single joints: tangential error, lost motion, axis, and deviation from the circle.

While joint k alone turns, a target moves on a circle. The tangential error of a reading is the angle at which the
target lies on that circle minus the commanded angle. The range of its mean over both directions is the error range
of the joint.

The reversal value is the difference between readings on the way up and on the way down. It is positive if the joint
comes to rest beyond its target, and negative if it stops short. Both values contain the deflection of the other
joints under gravity. Source: Nubiola 2.4.1 and Figures 2.10 to 2.15, and ISO 230-2 (reversal value).

The circle through the points of a sweep is fitted so that the joint's error does not distort it. A circle fitted to
commanded angles alone takes part of that error for a shift of its centre: over half a turn, an error of three waves
grows by half. A circle fitted to distances from plane and circle alone leaves the centre of a short arc
undetermined. So both are fitted, each weighted by the scatter that it leaves. A joint without error contributes its
angles in full; a joint with large errors contributes hardly any. Each direction of the sweep has a separate offset
angle.
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

    `angle` is that between the directions, rad. `distance` is that from the centre of the circle to the identified
    axis, mm. `u_angle` and `u_distance` are standard uncertainties of the contribution of the circle alone.
    """

    angle: float
    u_angle: float
    distance: float
    u_distance: float


@dataclass(frozen=True)
class JointSweep:
    """The result of a sweep of n readings at p places.

    Attributes
    ----------
    joint : int
        Number of the joint, from 1.
    angle, tangential : array of shape (n,)
        Commanded angles and tangential errors, rad.
    radial : array of shape (n,)
        Deviations from the circle along its radius, mm; outwards above zero.
    axial : array of shape (n,)
        Deviations from the plane of the circle along its axis, mm. The axis points according to the right-hand rule.
    radial_rms, radial_largest, axial_rms, axial_largest : float
        RMS and largest absolute value of these deviations, mm.
    upwards : array of bool, shape (n,)
        Whether the reading was reached upwards.
    places : array of shape (p,)
        Commanded angles, ascending, rad.
    error : array of shape (p,)
        Tangential error at each place without the reversal, rad.
    reversal, u_reversal : float or None
        Reversal value (up minus down) and its standard uncertainty, rad. The reversal is None if no place was reached
        in both directions, and its uncertainty also if only one place was.
    """

    joint: int
    series: str
    target: str
    radius: float
    angle: Array
    tangential: Array
    radial: Array
    axial: Array
    radial_rms: float
    radial_largest: float
    axial_rms: float
    axial_largest: float
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
    """Analyse all sweeps of the calibration readings, ordered by series, joint and target.

    Parameters
    ----------
    identified : IdentificationFit, optional
        Arm with whose axes those of the sweeps are compared. Its base is that of the same data set.

    Raises
    ------
    DataError
        There is no sweep.
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
    """Keep the readings whose other joints came from the most common combination of sides.

    The backlash of the other joints is then the same in all readings.
    """
    others = np.delete(dataset.conditions.side[sweep.rows], sweep.joint - 1, axis=1)
    _, pattern, count = np.unique(others, axis=0, return_inverse=True, return_counts=True)
    return replace(sweep, rows=sweep.rows[pattern.reshape(-1) == int(np.argmax(count))])


def _is_one_still(dataset: Dataset, sweep: CircleSweep) -> bool:
    """Test whether the remaining readings are enough for a sweep."""
    angle = dataset.conditions.joints[sweep.rows, sweep.joint - 1]
    return len(angle) >= FEWEST and bool(np.ptp(angle) >= LEAST_RANGE)


def _analysed(dataset: Dataset, sweep: CircleSweep, identified: IdentificationFit | None) -> JointSweep:
    conditions = dataset.conditions
    angle = conditions.joints[sweep.rows, sweep.joint - 1]
    upwards = conditions.side[sweep.rows, sweep.joint - 1] > 0
    circle = fit_circle(dataset.points[sweep.rows], angle, upwards)
    seen, radial, axial = circle.place(dataset.points[sweep.rows])
    tangential = np.angle(np.exp(1j * (seen - angle)))
    tangential = np.angle(np.exp(1j * (tangential - np.angle(np.exp(1j * tangential).sum()))))
    number, places = _places(angle)
    gaps = _mean(tangential, number, upwards) - _mean(tangential, number, ~upwards)
    gaps = gaps[np.isfinite(gaps)]
    reversal = float(gaps.mean()) if len(gaps) else None
    without = tangential - 0.5 * (reversal or 0.0) * np.where(upwards, 1.0, -1.0)
    error = _mean(without, number, np.ones(len(angle), dtype=bool))
    away = np.abs([radial, axial])
    rms, largest = np.sqrt(np.mean(away**2, axis=1)), away.max(axis=1)
    return JointSweep(
        joint=sweep.joint,
        series=conditions.series_names[sweep.series],
        target=conditions.target_names[sweep.target],
        radius=circle.radius,
        angle=angle,
        tangential=tangential,
        radial=radial,
        axial=axial,
        radial_rms=float(rms[0]),
        radial_largest=float(largest[0]),
        axial_rms=float(rms[1]),
        axial_largest=float(largest[1]),
        upwards=upwards,
        places=places,
        error=error,
        reversal=reversal,
        u_reversal=float(gaps.std(ddof=1) / np.sqrt(len(gaps))) if len(gaps) > 1 else None,
        axis=None if identified is None else _difference(dataset, sweep, circle, identified),
    )


def _places(angle: Array) -> tuple[NDArray[np.int64], Array]:
    """Number the places of commanded angles (n,), and return their angles (p,), ascending."""
    rounded, number = np.unique(np.round(angle / _SAME).astype(np.int64), return_inverse=True)
    return number.reshape(-1).astype(np.int64), _SAME * rounded.astype(np.float64)


def _mean(values: Array, number: NDArray[np.int64], rows: NDArray[np.bool_]) -> Array:
    """Average the values (n,) of some rows at each place, shape (p,); NaN without such rows."""
    places = int(number.max()) + 1
    count = np.bincount(number[rows], minlength=places)
    total = np.bincount(number[rows], weights=values[rows], minlength=places)
    return np.divide(total, count, out=np.full(places, np.nan), where=count > 0)


def _difference(
    dataset: Dataset, sweep: CircleSweep, circle: Circle, identified: IdentificationFit
) -> AxisDifference:
    """Compare the circle with the identified axis, averaged over the sweep.

    The axis moves a little during the sweep if gravity bends the arm.
    """
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
    """A circle in space.

    `direction` (3,) is the direction of its axis according to the right-hand rule, `centre` (3,) is in mm, and
    `radius` in mm. Angles count from `cosine` (3,) towards `sine` (3,). `u_direction` is the standard uncertainty
    of the direction, rad, and `u_centre` that of the centre in its plane, mm.
    """

    direction: Array
    centre: Array
    radius: float
    cosine: Array
    sine: Array
    u_direction: float
    u_centre: float

    def place(self, points: Array) -> tuple[Array, Array, Array]:
        """Return angles, rad, and radial and axial deviations, mm, of points (n, 3), each of shape (n,)."""
        away = points - self.centre
        x, y = away @ self.cosine, away @ self.sine
        return np.arctan2(y, x), np.hypot(x, y) - self.radius, away @ self.direction


def fit_circle(points: Array, angle: Array, upwards: NDArray[np.bool_]) -> Circle:
    """Fit a circle to points (n, 3), mm, at commanded angles (n,), rad.

    `upwards` (n,) states from which direction each was reached.
    """
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
