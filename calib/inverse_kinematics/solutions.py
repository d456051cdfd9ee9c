"""The eight branches of an arm's configuration by name, and the solutions of a batch of poses in them.

front / back, up / down and noflip / flip are the signs of what vanishes where the shoulder, the elbow and the wrist
are singular, as `calib.validation.branch` tells them of given joints:

    front   the wrist centre stands on the side of axis 1 on which it stands at the zero pose
    up      the forearm turns from the upper arm in the positive sense of axis 2
    noflip  axis 6 turns from axis 4 in the positive sense of axis 5
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.inverse_kinematics.turns import nearest_turns
from calib.kinematics import Array

BRANCHES = tuple(
    f"{f}/{u}/{w}" for f in ("front", "back") for u in ("up", "down") for w in ("noflip", "flip")
)

SINGULAR_SINE = 1e-6
"""Sine of the angle, or reach over the arm's length, below which a pose is told to be singular."""


class Reached(StrEnum):
    """What became of a pose in one branch."""

    YES = "reached"
    WRIST = "wrist singular: only the sum or difference of two joints is determined"
    ELBOW = "elbow singular: the arm is stretched or folded"
    SHOULDER = "shoulder singular: the wrist centre stands above axis 1"
    TOO_NEAR = "out of reach: too near to axis 1"
    TOO_FAR = "out of reach of upper arm and forearm"


REACHED = tuple(Reached)
UNREACHABLE = (REACHED.index(Reached.TOO_NEAR), REACHED.index(Reached.TOO_FAR))


def branch_index(name: str) -> int:
    """Position of a branch in `BRANCHES`. Raises ValueError for an unknown name."""
    if name not in BRANCHES:
        raise ValueError(f"branch {name!r} is not one of {', '.join(BRANCHES)}")
    return BRANCHES.index(name)


@dataclass(frozen=True)
class Solutions:
    """Solutions of n poses in the order of `BRANCHES`.

    joints: (n, 8, 6) model angles, rad, from -pi to pi, NaN where a branch does not reach; state: (n, 8) index into
    `REACHED`. In a singular pose the joints are one of the infinitely many that stand in it.
    """

    joints: Array
    state: NDArray[np.int8]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n, 8) whether the joints stand in the pose."""
        return ~np.isin(self.state, UNREACHABLE)

    @property
    def singular(self) -> NDArray[np.bool_]:
        """(n, 8) whether they stand in it and it is singular."""
        return self.valid & (self.state != 0)

    def why(self, row: int, branch: int) -> Reached:
        """What became of one pose in one branch."""
        return REACHED[self.state[row, branch]]

    def all_of(self, row: int) -> tuple[Reached, ...]:
        """What became of one pose in all branches."""
        return tuple(REACHED[state] for state in self.state[row])

    def within(self, lower: Array, upper: Array, seed: Array | None = None) -> Array:
        """(n, 8, 6) the turns within the limits (6,) nearest to `seed` (n, 6), default 0; NaN beyond limits. rad."""
        near = np.zeros(6) if seed is None else np.asarray(seed)[:, None, :]
        turned = nearest_turns(self.joints, near, lower, upper)
        return np.where(np.all(np.isfinite(turned), axis=2, keepdims=True), turned, np.nan)

    def nearest(self, seed: Array, lower: Array, upper: Array) -> tuple[Array, NDArray[np.int64]]:
        """Of every pose the solution nearest to `seed` (n, 6) within the limits (6,), and its branch.

        Nearest by the sum of squared joint differences. Joints (n, 6) rad, NaN, and branch (n,), -1, where there
        is none.
        """
        turned = self.within(lower, upper, seed)
        away = np.sum((turned - np.asarray(seed)[:, None, :]) ** 2, axis=2)
        away = np.where(np.isfinite(away), away, np.inf)
        best = np.argmin(away, axis=1)
        rows = np.arange(len(best))
        found = np.isfinite(away[rows, best])
        return turned[rows, best], np.where(found, best, -1)
