"""Joint axes from sweeps of single joints: a start for base and tool.

This start needs no nominal chain between base and tool. While one joint turns, a target runs on a circle
about its axis: p = c + A cos(theta) + B sin(theta). This is linear in c, A and B, with A and B of one
length and at right angles. The axes of joints 1 and 2 place the base, whose origin lies d_1 below them
as in the nominal robot. Those of the last two joints place the flange, and so the target. Only the
nominal robot states which points of which axes meet, so both DH conventions are treated alike.

Source: Nubiola, 2.3 (circle point analysis, Mooring, Roth and Driels 1991).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import BasePoses, Chain, forward, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array
from calib.data.dataset import Dataset
from calib.units import DEG

FEWEST = 6
"""Readings that make a sweep."""
LEAST_RANGE = 30.0 * DEG
"""Angle over which they must be spread."""

_STILL = 0.01 * DEG  # by which a joint that counts as still may move
_ROUNDS = 10
_PARALLEL = 5.0 * DEG  # two axes that meet under less have no reliable common perpendicular
_SURE = 0.02  # rad to which the direction of an axis must be known


@dataclass(frozen=True)
class CircleSweep:
    """Readings of one series and one target in which joint `joint` (1-based) alone moved.

    Attributes
    ----------
    rows : array of int, shape (n,)
        Index into the data set.
    posture : array of shape (N,)
        Model angles, rad; the angle of the joint itself is that of the first reading.
    """

    joint: int
    series: int
    target: int
    rows: NDArray[np.int64]
    posture: Array


@dataclass(frozen=True)
class Axes:
    """Axes of S sweeps, in the world.

    The target is at centre + cosine cos(theta) + sine sin(theta).

    Attributes
    ----------
    direction : array of shape (S, 3)
        Directions of the axes, by the right hand.
    centre : array of shape (S, 3)
        Centres of the circles, mm.
    cosine, sine : array of shape (S, 3)
        Radii at theta = 0 and 90 deg, mm.
    tilt : array of shape (S,)
        Standard uncertainty of the direction, rad, from the residuals of the circle.
    """

    direction: Array
    centre: Array
    cosine: Array
    sine: Array
    tilt: Array


@dataclass(frozen=True)
class Start:
    """Start values from the sweeps of a series.

    `base` is the base pose (4, 4), mm, or None. `targets` are positions (3,) in the nominal flange
    frame, mm, by target.
    """

    base: Array | None
    targets: dict[int, Array]


def find_sweeps(dataset: Dataset) -> tuple[CircleSweep, ...]:
    """Find the sweeps among the calibration readings.

    Their readings may be in any order of time, go back and forth, and have others between them.
    """
    conditions = dataset.conditions
    candidates = np.flatnonzero(dataset.fit_rows & dataset.pointed)
    joints = conditions.joints[candidates]
    series, target = conditions.series[candidates], conditions.target[candidates]
    numbers = np.column_stack([np.round(joints / _STILL).astype(np.int64), series, target])
    # One number per row that distinguishes rows, less the part of one joint; sorting it is all the search there is.
    parts = numbers * _factors(numbers.shape[1])
    out = []
    others = parts.sum(axis=1)[:, None] - parts[:, : joints.shape[1]]
    ordered = np.sort(others, axis=0)
    turning = np.array([kind == "turns" for kind in dataset.header.robot.kinds])
    for k in np.flatnonzero(turning & (ordered[FEWEST - 1 :] == ordered[: 1 - FEWEST]).any(axis=0)).tolist():
        _, group, count = np.unique(others[:, k], return_inverse=True, return_counts=True)
        for g in np.flatnonzero(count >= FEWEST):
            of = np.flatnonzero(group == g)
            if np.ptp(joints[of, k]) >= LEAST_RANGE:
                first = of[0]
                out.append(
                    CircleSweep(k + 1, int(series[first]), int(target[first]), candidates[of], joints[first])
                )
    return tuple(out)


@cache
def _factors(count: int) -> NDArray[np.int64]:
    """Return large random numbers, shape (count,), whose sums of products distinguish rows."""
    return np.random.default_rng(0).integers(1, 2**62, count)


def fit_axes(points: Array, angles: Array, measured: NDArray[np.bool_]) -> Axes:
    """Fit circles through the points of S sweeps at once, robustly (Huber weights).

    Parameters
    ----------
    points : array of shape (S, n, 3)
        Points, mm.
    angles : array of shape (S, n)
        Joint angles, rad.
    measured : array of bool, shape (S, n)
        False if a sweep has no further reading.
    """
    system = np.stack([np.ones_like(angles), np.cos(angles), np.sin(angles)], axis=-1)
    count = measured.sum(axis=1)
    weights = measured.astype(np.float64)
    found, normal, miss = np.zeros((len(points), 3, 3)), np.zeros((len(points), 3, 3)), np.zeros_like(angles)
    for _ in range(_ROUNDS):
        normal = np.einsum("sni,sn,snj->sij", system, weights, system)
        found = np.linalg.solve(normal, np.einsum("sni,sn,snx->six", system, weights, points))
        miss = np.linalg.norm(points - system @ found, axis=2)
        usual = np.nanmedian(np.where(measured, miss, np.nan), axis=1, keepdims=True)
        weights = measured * np.minimum(1.0, np.maximum(2.0 * usual, 1e-9) / np.maximum(miss, 1e-9))
    u, s, vt = np.linalg.svd(found[:, 1:].transpose(0, 2, 1), full_matrices=False)
    radius = s.mean(axis=1)
    arms = u @ vt * radius[:, None, None]  # the nearest two at right angles and of one length
    direction = np.cross(arms[:, :, 0], arms[:, :, 1]) / np.maximum(radius, 1e-12)[:, None] ** 2
    variance = np.sum(weights * miss**2, axis=1) / np.maximum(3 * count - 9, 1)
    spread = np.linalg.inv(normal)
    tilt = np.sqrt(variance * (spread[:, 1, 1] + spread[:, 2, 2])) / np.maximum(radius, 1e-12)
    return Axes(direction, found[:, 0], arms[:, :, 0], arms[:, :, 1], tilt)


def starts(dataset: Dataset) -> dict[int, Start]:
    """Compute start values for base and tool from sweeps, by series.

    A series without usable sweeps is not included.
    """
    sweeps = find_sweeps(dataset)
    if not sweeps:
        return {}
    longest = max(len(sweep.rows) for sweep in sweeps)
    points, angles = np.zeros((len(sweeps), longest, 3)), np.zeros((len(sweeps), longest))
    measured = np.zeros((len(sweeps), longest), dtype=bool)
    for i, sweep in enumerate(sweeps):
        n = len(sweep.rows)
        points[i, :n], measured[i, :n] = dataset.points[sweep.rows], True
        angles[i, :n] = dataset.conditions.joints[sweep.rows, sweep.joint - 1]
    axes = fit_axes(points, angles, measured)
    out = {}
    for series in sorted({sweep.series for sweep in sweeps}):
        here = [i for i, s in enumerate(sweeps) if s.series == series and axes.tilt[i] < _SURE]
        here.sort(key=lambda i: axes.tilt[i])
        start = Start(
            _base(dataset.header.robot, sweeps, axes, here), _tool(dataset.header.robot, sweeps, axes, here)
        )
        if start.base is not None or start.targets:
            out[series] = start
    return out


def _base(robot: Robot, sweeps: tuple[CircleSweep, ...], axes: Axes, here: list[int]) -> Array | None:
    """Base pose (4, 4) in the world, from the surest sweeps of joints 1 and 2."""
    first = next((i for i in here if sweeps[i].joint == 1), None)
    second = next((i for i in here if sweeps[i].joint == 2), None)
    if first is None or second is None:
        return None
    nominal = _frame(_axis(robot, sweeps[first].posture, 1), _axis(robot, sweeps[second].posture, 2))
    found = _frame(_line(axes, first), _line(axes, second))
    return None if nominal is None or found is None else found @ np.linalg.inv(nominal)


def _tool(robot: Robot, sweeps: tuple[CircleSweep, ...], axes: Axes, here: list[int]) -> dict[int, Array]:
    """Compute the targets in the flange frame from sweeps of the last two joints.

    Joints 1 to N-2 must be at the same angles in both sweeps.
    """
    last = robot.joints
    out: dict[int, Array] = {}
    for i in (i for i in here if sweeps[i].joint == last and sweeps[i].target not in out):
        posture = sweeps[i].posture.copy()
        posture[last - 1] = 0.0
        for j in (j for j in here if sweeps[j].joint == last - 1):
            if np.abs(sweeps[j].posture[: last - 2] - posture[: last - 2]).max() > 2.0 * _STILL:
                continue
            nominal = _frame(_axis(robot, posture, last), _axis(robot, posture, last - 1))
            found = _frame(_line(axes, i), _line(axes, j))
            if nominal is not None and found is not None:
                flange = found @ np.linalg.inv(nominal) @ forward(robot, posture[None])[0]
                point = axes.centre[i] + axes.cosine[i]
                out[sweeps[i].target] = flange[:3, :3].T @ (point - flange[:3, 3])
                break
    return out


def _line(axes: Axes, i: int) -> tuple[Array, Array]:
    return axes.centre[i], axes.direction[i]


def _axis(robot: Robot, posture: Array, joint: int) -> tuple[Array, Array]:
    """Return a point and the direction of a joint's axis at a posture (N,).

    Both are those of the nominal robot in the base frame.
    """
    frames = propagate(Chain.of(robot), nominal_values(robot, posture[None]), BasePoses())
    slot = f"theta{joint}"
    return np.ravel(frames.origin[slot][:, -1]), np.ravel(frames.axis[slot][:, -1])


def _frame(one: tuple[Array, Array], other: tuple[Array, Array]) -> Array | None:
    """Build the frame (4, 4) of two lines; None if they are parallel.

    z points along the first line and x towards the second. The origin is on the first line at its
    nearest point.
    """
    (p, z), (q, w) = one, other
    across = w - (w @ z) * z
    sine = np.linalg.norm(across)
    if sine < np.sin(_PARALLEL):
        return None
    pose = np.eye(4)
    x = across / sine
    pose[:3, :3] = np.column_stack([x, np.cross(z, x), z])
    across = q - p
    pose[:3, 3] = p + z * (across @ z - (across @ x) * (w @ z) / sine)
    return pose
