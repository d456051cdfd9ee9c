"""The eight branches of an arm's configuration by name, and the solutions of a batch of poses in them.

front / back, up / down and noflip / flip are the signs of what vanishes where the shoulder, the elbow and the wrist
are singular, as `calib.validation.branch` finds them for given joints:

    front   the wrist centre lies on the side of axis 1 on which it lies at the zero pose
    up      the forearm turns from the upper arm in the positive sense of axis 2
    noflip  axis 6 turns from axis 4 in the positive sense of axis 5
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

BRANCHES = tuple(
    f"{f}/{u}/{w}" for f in ("front", "back") for u in ("up", "down") for w in ("noflip", "flip")
)

SINGULAR_SINE = 1e-6
"""Sine of the angle, or reach over the arm's length, below which a pose is reported as singular."""


class Reached(StrEnum):
    """The outcome for a pose in one branch."""

    YES = "reached"
    WRIST = "wrist singular: only the sum or difference of two joints is determined"
    ELBOW = "elbow singular: the arm is stretched or folded"
    SHOULDER = "shoulder singular: the wrist centre lies above axis 1"
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
    """The solutions of n poses in the order of `BRANCHES`.

    joints: (n, 8, 6) model angles, rad, from -pi to pi, NaN where a branch does not reach; state: (n, 8) index into
    `REACHED`. In a singular pose the joints are one of the infinitely many that reach it.
    """

    joints: Array
    state: NDArray[np.int8]

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n, 8) whether the joints reach the pose."""
        return ~np.isin(self.state, UNREACHABLE)

    def all_of(self, row: int) -> tuple[Reached, ...]:
        """The outcome for one pose in all branches."""
        return tuple(REACHED[state] for state in self.state[row])
