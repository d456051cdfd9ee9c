"""Degrees of freedom of an arm's tool point, from the rank of its Jacobian.

Six axes or more shift and turn the tool in every direction. A SCARA or a palletizer shifts it in three
directions and turns it about one; a two-axis positioner turns it about two. The Jacobian J (6 x m) of
the joints that the controller can move determines the degrees of freedom, for an arm of any type:

    count    the largest number of singular values above `SINGULAR` of the first, among postures all over the limits
    places   whether three of them shift the tool point: then its position comes first and orientation takes what is
             left of the joints; otherwise shift and turn are weighed with `LEVER_MM`

A joint that its limits hold in place does not count, such as the wrist of a palletizer, which its rods
keep level. Nor does a slide that the other joints do not need: a track keeps its position. If several
changes of the joints give the same turn (seven axes), the one nearest to the present posture is taken.

Sources: Siciliano & Slotine 1991 (position before orientation), Wampler 1986 (damping).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import joint_scale, nominal_jacobian
from calib.arm.robot import Robot
from calib.array import Array

SINGULAR = 0.004
"""Least over largest singular value below which a target is refused: the wrist within some 2 deg of singular."""

HELD = 4e-4
"""rad or mm: limits that are no further apart hold a joint in place."""

_CUT = 0.25 * SINGULAR  # of the largest singular value: below it lies what the arm does not have
_DAMPING = 1e-12  # of the trace: only keeps an exactly singular pose solvable
_SAMPLES = 64


@dataclass(frozen=True)
class Freedoms:
    """Directions in which an arm of N joints can move its tool point.

    Attributes
    ----------
    columns : array of shape (N, m)
        Change of the model's joints for a unit of every joint that is moved. The unit is 1 rad, or
        `LEVER_MM` of a slide.
    count, places
        See the module docstring.
    turns : int
        Number of directions about which the tool can turn, if the tool point may move.
    """

    columns: Array
    count: int
    places: bool
    turns: int

    @classmethod
    def of(cls, robot: Robot, limits: Array, coupling: str, tool: Array) -> Freedoms:
        """Find the freedoms of an arm within limits (N, 2), in controller angles.

        Raises
        ------
        KeyError
            The robot has no joint matrix `coupling`.
        """
        low, high = np.min(limits, axis=1), np.max(limits, axis=1)
        counted = np.random.default_rng(1).uniform(low, high, (_SAMPLES, robot.joints))
        jacobian = nominal_jacobian(robot, robot.model_angles(counted, coupling), tool)[1]
        eye = np.diag(joint_scale(robot))
        columns = (robot.model_angles(eye, coupling) - robot.model_angles(0.0 * eye, coupling)).T
        moves = high - low > HELD
        count = _rank(jacobian @ columns[:, moves])
        for k in np.flatnonzero([kind == "slides" for kind in robot.kinds]):
            without = moves & (np.arange(robot.joints) != k)
            if _rank(jacobian @ columns[:, without]) == count:
                moves = without
        columns = columns[:, moves]
        return cls(
            columns,
            count,
            places=_rank(jacobian[:, :3] @ columns, jacobian @ columns) == 3,
            turns=_rank(jacobian[:, 3:] @ columns, jacobian @ columns),
        )

    @property
    def all(self) -> bool:
        """Whether the arm has all six degrees of freedom."""
        return self.count == 6

    def step(self, jacobian: Array, miss: Array) -> tuple[Array, Array]:
        """Solve for the change of the joints that corrects what the arm can correct of an error.

        Parameters
        ----------
        jacobian : array of shape (n, 6, N)
            Scaled Jacobian, see `nominal_jacobian`.
        miss : array of shape (n, 6)
            Error of the poses, scaled like the rows of the Jacobian.

        Returns
        -------
        change : array of shape (n, N)
            Change of the joints.
        corrected : array of shape (n, 6)
            The part of `miss` that this change corrects.
        """
        moved = jacobian @ self.columns
        if self.all:
            across = moved @ moved.transpose(0, 2, 1)
            damping = _DAMPING * np.trace(across, axis1=1, axis2=2)
            across += damping[:, None, None] * np.eye(6)
            drives = moved.transpose(0, 2, 1) @ np.linalg.solve(across, miss[:, :, None])
            return (drives[:, :, 0]) @ self.columns.T, miss
        least = _CUT * np.linalg.norm(moved, ord=2, axis=(1, 2))
        if not self.places:
            drives = _times(_inverse(moved, least), miss)
            return drives @ self.columns.T, _times(moved, drives)
        shifts, turns = moved[:, :3], moved[:, 3:]
        back = _inverse(shifts, least)
        drives = _times(back, miss[:, :3])
        shifted = _times(shifts, drives)
        rest = miss[:, 3:] - _times(turns, drives)
        free = turns - turns @ back @ shifts  # turns that leave the position alone
        more = _times(_inverse(free, least), rest)
        return (drives + more) @ self.columns.T, np.hstack([shifted, _times(free, more)])

    def margin(self, jacobian: Array) -> Array:
        """Measure how close poses are to singular ones, shape (n,).

        The measure is the ratio of the least to the largest singular value within the freedoms of the arm.
        """
        values = np.linalg.svd(jacobian @ self.columns, compute_uv=False)
        least = values[:, self.count - 1] if self.count else np.zeros(len(jacobian))
        if self.places and not self.all:
            least = np.minimum(least, np.linalg.svd(jacobian[:, :3] @ self.columns, compute_uv=False)[:, 2])
        return least / values[:, 0]

    def same_branch(self, start: Array, end: Array) -> NDArray[np.bool_]:
        """Test whether no singular pose lies between two postures, shape (n,).

        `start` and `end` are their Jacobians (n, 6, N). The determinant within the arm's freedoms
        changes its sign wherever a singular surface is crossed. The result is always true for arms that
        have more joints than freedoms.
        """
        if self.columns.shape[1] != self.count:
            return np.ones(len(start), dtype=bool)
        one, other = start @ self.columns, end @ self.columns
        basis = np.linalg.svd(one, full_matrices=False)[0].transpose(0, 2, 1)
        return np.sign(np.linalg.det(basis @ one)) == np.sign(np.linalg.det(basis @ other))


def _rank(matrices: Array, among: Array | None = None) -> int:
    """Return the largest rank of the matrices (n, ., m).

    Singular values are negligible if they are small compared with the norm of `among` (default: the
    matrices themselves).
    """
    values = np.linalg.svd(matrices, compute_uv=False)
    largest = np.linalg.norm(matrices if among is None else among, ord=2, axis=(1, 2))
    return int(np.max(np.sum(values > SINGULAR * largest[:, None], axis=1), initial=0))


def _inverse(matrices: Array, least: Array) -> Array:
    """Pseudo-inverses of (n, k, m) matrices, singular values below `least` (n,) taken as none."""
    u, values, v = np.linalg.svd(matrices, full_matrices=False)
    kept = values > least[:, None]
    inverted = np.where(kept, 1.0 / np.where(kept, values, 1.0), 0.0)
    return (v.transpose(0, 2, 1) * inverted[:, None, :]) @ u.transpose(0, 2, 1)


def _times(matrices: Array, vectors: Array) -> Array:
    return (matrices @ vectors[:, :, None])[:, :, 0]
