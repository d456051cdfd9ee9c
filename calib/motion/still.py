"""The standstills of a moving robot: samples slower than a limit, grouped into poses and numbered as waypoints."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from calib.array import Array
from calib.errors import DataError
from calib.motion.alignment import Aligned
from calib.motion.solve import SLOW_MM_S
from calib.units import DEG

_CREEP = 0.2 * DEG  # of any joint, within one standstill
_SAME_POSE = 0.5 * DEG  # of every joint, of one waypoint


@dataclass(frozen=True)
class Standstills:
    """k samples at which the robot was still.

    sample (k,): index among the aligned samples; number (k,): of the standstill, from 0; waypoint (k,): number of the
    pose, from 0 in the order of the first visit. Standstills within 0.5 deg of each other in all joints, directly or
    through others, are of one waypoint, whenever they were.
    """

    sample: NDArray[np.int64]
    number: NDArray[np.int64]
    waypoint: NDArray[np.int64]

    @property
    def count(self) -> int:
        """Number of standstills."""
        return int(self.number[-1]) + 1

    @property
    def waypoints(self) -> int:
        """Number of poses."""
        return int(self.waypoint.max()) + 1


def standstills(aligned: Aligned, slow_mm_s: float = SLOW_MM_S) -> Standstills:
    """The samples at which the tool, by the robot's own joints, is slower than `slow_mm_s`, gross errors apart.

    A robot that creeps is cut where a joint has gone 0.2 deg. Raises DataError where the robot is never still.
    """
    sample = np.flatnonzero((aligned.speed < slow_mm_s) & (aligned.weight > 0.0))
    if not len(sample):
        raise DataError(
            f"never stands still: its tool is never slower than {slow_mm_s:g} mm/s (slowest "
            f"{aligned.speed.min():.2g} mm/s).",
            do="Let the robot rest for a second at every waypoint, or raise --slower-than.",
            file="robot stream",
        )
    joints = aligned.joints[sample]
    apart = (np.diff(sample) > 1) | (np.max(np.abs(np.diff(joints, axis=0)), axis=1) > _CREEP)
    first = np.maximum.accumulate(np.where(np.append(True, apart), np.arange(len(sample)), 0))
    gone = np.max(np.abs(joints - joints[first]), axis=1) // _CREEP
    number = np.cumsum(np.append(False, apart | (np.diff(gone) != 0.0)))
    return Standstills(sample, number, _waypoints(means(joints, number))[number])


def means(values: Array, group: NDArray[np.int64]) -> Array:
    """(g, c) means of rows (k, c) by the number of their group (k,)."""
    count = np.bincount(group).astype(np.float64)
    return np.stack([np.bincount(group, column) for column in values.T], axis=1) / count[:, None]


def _waypoints(joints: Array) -> NDArray[np.int64]:
    """(s,) number of the pose of every standstill with joints (s, N), in the order of the first visit."""
    near = KDTree(joints).query_pairs(_SAME_POSE, p=np.inf, output_type="ndarray")
    links = coo_array((np.ones(len(near)), (near[:, 0], near[:, 1])), shape=(len(joints), len(joints)))
    group = connected_components(links, directed=False)[1]
    _, first, number = np.unique(group, return_index=True, return_inverse=True)
    return np.argsort(np.argsort(first))[number]
