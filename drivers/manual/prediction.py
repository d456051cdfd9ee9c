"""The prediction of a typed point from the nominal robot and the readings before it.

The nominal robot errs by millimetres and its place in the cell file by more. Earlier readings determine their common
error, the rigid motion that moves predicted points onto them (Kabsch; Umeyama, PAMI 13, 1991). The rest is the error of
the robot and of the tool, and a point that is off by much more was mistyped. Lengths in mm.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

ENOUGH = 8
_TIMES = 5.0  # the scatter, per axis, of the readings so far
_LEAST_MM = 2.0
_SPREAD_MM = 50.0  # of predicted points along their second axis: below, they fix no turn

Points = NDArray[np.float64]


class Prediction:
    """The prediction of one execution.

    `within_mm` is the largest permitted distance of a point before there are enough readings.
    """

    def __init__(self, within_mm: float) -> None:
        self._within_mm = within_mm
        self._near: list[Sequence[float]] = []
        self._seen: list[Sequence[float]] = []

    def learn(self, near_mm: Sequence[float], seen_mm: Sequence[float]) -> None:
        """Add an accepted point, and its place according to the nominal robot."""
        self._near.append(near_mm)
        self._seen.append(seen_mm)

    def expect(self, near_mm: Sequence[float]) -> tuple[tuple[float, ...], float]:
        """Return the expected place of a point, and its largest permitted distance from there."""
        near, seen = np.array(self._near).reshape(-1, 3), np.array(self._seen).reshape(-1, 3)
        if len(near) < ENOUGH or np.linalg.svd(near - near.mean(axis=0))[1][1] < _SPREAD_MM:
            return tuple(near_mm), self._within_mm
        turn, shift = carried(near, seen)
        left = seen - (near @ turn.T + shift)
        scatter = float(
            np.sqrt(np.mean(left**2) * len(near) / (len(near) - 2))
        )  # six of three a point were fitted
        place = turn @ np.array(near_mm) + shift
        return tuple(map(float, place)), min(self._within_mm, max(_LEAST_MM, _TIMES * scatter))


def carried(near: Points, seen: Points) -> tuple[Points, Points]:
    """Compute the rotation (3, 3) and shift (3,) that move (n, 3) points closest to others."""
    a, b = near.mean(axis=0), seen.mean(axis=0)
    u, _, v = np.linalg.svd((near - a).T @ (seen - b))
    mirror = np.diag([1.0, 1.0, np.sign(np.linalg.det(v.T @ u.T))])
    turn = v.T @ mirror @ u.T
    return turn, b - turn @ a
