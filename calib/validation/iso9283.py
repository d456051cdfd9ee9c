"""Criteria of ISO 9283:1998 from repeated visits to the same commanded poses.

The positions x_j of n visits have the barycentre x- and the command c. With l_j = |x_j - x-| and s with n - 1:

    AP_p = |x- - c|                        pose accuracy, position
    RP_l = l- + 3 s_l                      pose repeatability, position
    AP_k = a-_k - c_k,  RP_k = 3 s_k       the same of the orientation, for its angle about each axis k
    AD_p = |D- - D_c|,  RD = 3 s_D         distance accuracy and repeatability; D_j = |x_1j - x_2j| of two poses
    vAP_p = max |x-_h - x-_k|              multi-directional variation: poses approached from several directions
    vAP_k = max |a-_hk - a-_lk|            the same of the orientation

Repeatability is that of visits from one direction. If a pose was visited from several directions, each with two visits
or more, the worst of them counts. Distances count visits from the direction from which either pose was visited most.

Angles are components of the rotation vector from the command, which for small angles are those about the axes of
the world. The command is where a model expects the tool target for the commanded joint angles. The standard asks for
30 visits of five poses on a plane of its test cube, at rated load and speed. The actual number of visits is reported
next to every result.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

VISITS_OF_THE_STANDARD = 30


@dataclass(frozen=True)
class PoseFigures:
    """Results for a commanded pose, lengths in mm, angles in rad.

    A value is NaN if no direction has two visits, and therefore no spread.
    """

    reading: int  # row of the first visit
    visits: int
    accuracy: float
    repeatability: float
    accuracy_angles: tuple[float, ...] | None  # about x, y, z; None without orientations
    repeatability_angles: tuple[float, ...] | None
    variation: float | None  # None unless two directions have two visits each
    variation_angles: tuple[float, ...] | None
    directions: int


@dataclass(frozen=True)
class DistanceFigures:
    """Distance accuracy and repeatability of two repeated poses, mm."""

    readings: tuple[int, int]  # rows of the first visit to either
    visits: int
    accuracy: float
    repeatability: float


def pose_accuracy(visits: Array, command: Array) -> float:
    """Compute AP_p of points (n, 3) and command (3,), mm."""
    return float(np.linalg.norm(visits.mean(axis=0) - command))


def pose_repeatability(visits: Array) -> float:
    """Compute RP_l of points (n, 3), mm; NaN for a single visit."""
    if len(visits) < 2:
        return math.nan
    lengths = np.linalg.norm(visits - visits.mean(axis=0), axis=1)
    return float(lengths.mean() + 3.0 * lengths.std(ddof=1))


def distance_figures(first: Array, second: Array, command: float) -> tuple[float, float]:
    """Compute AD_p and RD of two poses visited in turn, points (n, 3) each, mm.

    RD is NaN for a single visit.
    """
    distances = np.linalg.norm(first - second, axis=1)
    spread = float(distances.std(ddof=1)) if len(distances) > 1 else math.nan
    return abs(float(distances.mean()) - command), 3.0 * spread


def variation(barycentres: Array) -> float:
    """Compute vAP_p of the barycentres (k, 3) of k directions, mm."""
    return max(float(np.linalg.norm(a - b)) for a, b in itertools.combinations(barycentres, 2))


def repeated_poses(*same: NDArray[np.generic]) -> list[NDArray[np.int64]]:
    """Find the rows of every pose visited twice or more, in the order of the first visits.

    The arrays (n,) or (n, k) in `same` are equal for visits of one pose. Angles are compared to 1e-9 rad.
    """
    keys = np.round(np.column_stack(same).astype(np.float64), 9)
    _, which = np.unique(keys, axis=0, return_inverse=True)
    rows = [np.flatnonzero(which == k) for k in range(which.max() + 1)] if len(keys) else []
    return sorted((found for found in rows if len(found) > 1), key=lambda found: int(found[0]))


def figures_of_pose(
    rows: NDArray[np.int64], points: Array, commands: Array, angles: Array | None, sides: Array
) -> PoseFigures:
    """Compute the results of the pose that `rows` visited.

    Parameters
    ----------
    points, commands : array of shape (n, 3)
        Measured and commanded points, mm.
    angles : array of shape (n, 3) or None
        Rotation vectors from the command, rad, NaN if not measured.
    sides : array of shape (n, N)
        Sides of approach of the joints. Visits with the same sides came from one direction.
    """
    visits, command = points[rows], commands[rows].mean(axis=0)
    turned = None if angles is None or not np.isfinite(angles[rows]).all() else angles[rows]
    _, direction = np.unique(sides[rows], axis=0, return_inverse=True)
    # One visit alone has no spread
    groups = [direction == k for k in np.flatnonzero(np.bincount(direction) > 1)]
    moved = turns = spread = None
    if len(groups) > 1:
        moved = variation(np.array([visits[one].mean(axis=0) for one in groups]))
        if turned is not None:
            turns = tuple(np.ptp([turned[one].mean(axis=0) for one in groups], axis=0).tolist())
    if turned is not None and groups:
        spread = tuple((3.0 * np.max([turned[one].std(axis=0, ddof=1) for one in groups], axis=0)).tolist())
    return PoseFigures(
        reading=int(rows[0]),
        visits=len(rows),
        accuracy=pose_accuracy(visits, command),
        repeatability=max((pose_repeatability(visits[one]) for one in groups), default=math.nan),
        accuracy_angles=None if turned is None else tuple(turned.mean(axis=0).tolist()),
        repeatability_angles=spread,
        variation=moved,
        variation_angles=turns,
        directions=int(direction.max()) + 1,
    )


def unidirectional(rows: NDArray[np.int64], sides: Array) -> NDArray[np.int64]:
    """Select the visits among `rows` from the most frequent direction.

    The sides of approach have shape (n, N).
    """
    _, direction = np.unique(sides[rows], axis=0, return_inverse=True)
    return rows[direction == np.bincount(direction).argmax()]


def figures_between(
    first: NDArray[np.int64], second: NDArray[np.int64], points: Array, commands: Array
) -> DistanceFigures:
    """Compute the distance results of two poses.

    The k-th visits belong together; surplus visits are left out.
    """
    n = min(len(first), len(second))
    a, b = first[:n], second[:n]
    command = commands[a].mean(axis=0) - commands[b].mean(axis=0)
    accuracy, repeatability = distance_figures(points[a], points[b], float(np.linalg.norm(command)))
    return DistanceFigures((int(a[0]), int(b[0])), n, accuracy, repeatability)
