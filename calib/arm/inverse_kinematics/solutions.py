"""The branches of an arm's configuration by name, and the solutions of a batch of poses in them.

front / back, up / down and noflip / flip are the signs of what vanishes where the shoulder, the elbow and the wrist
are singular, as `calib.validation.groups` finds them for given joints of six axes:

    front   the wrist centre lies on the side of axis 1 on which it lies at the zero pose
    up      the forearm turns from the upper arm in the positive sense of axis 2
    noflip  axis 6 turns from axis 4 in the positive sense of axis 5

An arm without a wrist that bends (palletizers, five axes) has no third word. Of seven axes, front is an axis 3 that
turns from axis 1 in the positive sense of axis 2, up the same of axes 3, 5 and 4, noflip of axes 5, 7 and 6. A SCARA is
`right` where its forearm turns from its upper arm anticlockwise, seen from above, as a person's right arm, else `left`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.arm.inverse_kinematics.columns import wrapped
from calib.array import Array

BRANCHES = tuple(
    f"{f}/{u}/{w}" for f in ("front", "back") for u in ("up", "down") for w in ("noflip", "flip")
)

WITHOUT_WRIST = tuple(f"{f}/{u}" for f in ("front", "back") for u in ("up", "down"))

SINGULAR_SINE = 1e-6
"""Sine of the angle, or reach over the arm's length, below which a pose is reported as singular."""


class Reached(StrEnum):
    """The outcome for a pose in one branch."""

    YES = "reached"
    WRIST = "wrist singular: only the sum or difference of two joints is determined"
    ELBOW = "elbow singular: the arm is stretched or folded"
    SHOULDER = "shoulder singular: the wrist centre, or of seven axes the upper arm, lies above axis 1"
    TOO_NEAR = "out of reach: too near to axis 1"
    TOO_FAR = "out of reach of upper arm and forearm"
    TILTED = "out of reach: this arm cannot tilt its tool so"


REACHED = tuple(Reached)
UNREACHABLE = (REACHED.index(Reached.TOO_NEAR), REACHED.index(Reached.TOO_FAR), REACHED.index(Reached.TILTED))


@dataclass(frozen=True)
class Solutions:
    """The solutions of n poses in B branches.

    joints: (n, B, N) of the model, angles in rad from -pi to pi, NaN where a branch does not reach; state: (n, B) index
    into `REACHED`; branches: B names. In a singular pose the joints are one of the infinitely many that reach it.
    """

    joints: Array
    state: NDArray[np.int8]
    branches: tuple[str, ...] = BRANCHES

    @classmethod
    def of(
        cls,
        branches: tuple[str, ...],
        joints: Sequence[Array],
        states: Sequence[tuple[Reached, NDArray[np.bool_]]],
        turns: tuple[bool, ...],
        n: int,
    ) -> Solutions:
        """Solutions of N joints and masks of states, which broadcast to (branch, ..., n); the weightiest state last."""
        shape = np.broadcast_shapes(
            *(np.shape(joint) for joint in joints), *(mask.shape for _, mask in states)
        )
        found = np.stack(
            [np.broadcast_to(joint, shape).reshape(len(branches), n).T for joint in joints], axis=2
        )
        state = np.zeros(shape, dtype=np.int8)
        for what, mask in states:
            state[np.broadcast_to(mask, shape)] = REACHED.index(what)
        solutions = cls(wrapped(found, turns), state.reshape(len(branches), n).T.copy(), branches)
        solutions.joints[~solutions.valid] = np.nan
        return solutions

    @property
    def valid(self) -> NDArray[np.bool_]:
        """(n, B) whether the joints reach the pose."""
        return ~np.isin(self.state, UNREACHABLE)

    def all_of(self, row: int) -> tuple[Reached, ...]:
        """The outcome for one pose in all branches."""
        return tuple(REACHED[state] for state in self.state[row])
