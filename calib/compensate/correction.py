"""Correction of each target: joints to drive or a refusal, and the remaining error.

The remaining error of a corrected pose has a part that the arm could correct, and a part that it cannot.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arm.freedoms import Freedoms
from calib.arm.kinematics import LEVER_MM, nominal_jacobian, pose_difference
from calib.arm.robot import Robot
from calib.array import Array
from calib.units import DEG

LANDED_MM, LANDED_RAD = 1e-7, 1e-9


class Status(StrEnum):
    """Result of one target."""

    CORRECTED = "corrected"
    OUT_OF_REACH = "out of reach"
    SINGULAR = "singular"
    BEYOND_LIMITS = "beyond limits"
    NOT_CONVERGED = "not converged"
    OUTSIDE_REGION = "outside the region of the regression"
    UNCERTAIN = "uncertain"


ALL = tuple(Status)

REASONS = {
    Status.CORRECTED: "",
    Status.OUT_OF_REACH: "the arm does not reach the target in its branch within the joint limits",
    Status.SINGULAR: "close to a singular pose, where a small correction needs a large turn of the joints",
    Status.BEYOND_LIMITS: "the target or its correction lies beyond a joint limit",
    Status.OUTSIDE_REGION: "outside the joint angles that the regression in the model was trained at, where it means "
    "nothing",
    Status.UNCERTAIN: "the model knows its position less well than was asked for",
    Status.NOT_CONVERGED: "the iteration did not end near the target: it would change the branch, or the model is wild",
}

SHOWN_MM, SHOWN_RAD = 5e-4, 5e-4 * DEG
"""What is left below this does not show in three decimals."""


@dataclass(frozen=True)
class ResidualError:
    """The error that the arm cannot correct.

    Attributes
    ----------
    off : array of shape (n,)
        Position error, mm; infinite if a target was not solved.
    askew : array of shape (n,)
        Orientation error, rad; infinite if a target was not solved.
    tilt : bool
        Whether the arm turns about one direction, so that the remaining orientation error is a tilt of
        that axis.
    """

    off: Array
    askew: Array
    tilt: bool

    def in_words(self, off: float, askew: float) -> str:
        """Describe the remaining error as a sentence part; '' if it does not show."""
        parts = []
        if SHOWN_MM <= off < np.inf:
            parts.append(f"{off:.3f} mm that this arm cannot move")
        if SHOWN_RAD <= askew < np.inf:
            parts.append(
                f"{askew / DEG:.3f} deg of {'tilt' if self.tilt else 'turn'} that this arm cannot turn"
            )
        return " and ".join(parts)


@dataclass(frozen=True)
class Correction:
    """Corrected targets. A refused target must never be driven.

    Attributes
    ----------
    joints : array of shape (n, N)
        Joints to drive, rad or mm; NaN if refused.
    landed, turned : array of shape (n,)
        Distance, mm, and angle, rad, of the calibrated model at `joints` from the target pose, within
        the freedoms of the arm.
    left : ResidualError
        The error outside these freedoms.
    iterations : array of int, shape (n,)
        Iterations for each target.
    beyond : tuple
        For each target, joints and other quantities outside the range in which carried terms were measured.
    """

    joints: Array
    status: tuple[Status, ...]
    landed: Array
    turned: Array
    left: ResidualError
    iterations: NDArray[np.int64]
    beyond: tuple[tuple[str, ...], ...] = ()

    @property
    def good(self) -> NDArray[np.bool_]:
        """Mask of the targets that may be driven, shape (n,)."""
        return np.array([s is Status.CORRECTED for s in self.status], dtype=bool)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Reason why each target was refused, as a sentence part, or ''."""
        return tuple(REASONS[s] for s in self.status)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentence parts on each target that may be driven.

        They state the error that the arm cannot correct, and the quantities outside the measured range,
        where carried terms keep their value.
        """
        out = []
        for i, good in enumerate(self.good):
            words = self.left.in_words(float(self.left.off[i]), float(self.left.askew[i]))
            parts = [f"left: {words}"] if words else []
            if self.beyond and self.beyond[i]:
                parts.append(f"outside measured range: {', '.join(self.beyond[i])}")
            out.append("; ".join(parts) if good else "")
        return tuple(out)

    def without_uncertain(self, uncertain: NDArray[np.bool_]) -> Correction:
        """The correction with the targets of the mask (n,) refused unless they were before."""
        rows = uncertain & self.good
        status = [Status.UNCERTAIN if row else status for row, status in zip(rows, self.status, strict=True)]
        return replace(self, joints=np.where(rows[:, None], np.nan, self.joints), status=tuple(status))

    @classmethod
    def of(
        cls,
        joints: Array,
        refusals: Sequence[tuple[Status, NDArray[np.bool_]]],
        landed: Array,
        turned: Array,
        left: ResidualError,
        iterations: NDArray[np.int64],
    ) -> Correction:
        """Build a correction from masks of refused rows by reason.

        A later reason replaces an earlier one, so the most important comes last.
        """
        status = np.zeros(len(joints), dtype=np.int64)
        for reason, rows in refusals:
            status[rows] = ALL.index(reason)
        return cls(
            np.where((status == 0)[:, None], joints, np.nan),
            tuple(ALL[i] for i in status),
            landed,
            turned,
            left,
            iterations,
        )


@dataclass(frozen=True)
class TargetErrors:
    """Errors of n targets, mm and rad, infinite if not known.

    Attributes
    ----------
    landed, turned : array of shape (n,)
        Within the freedoms of the arm.
    off, askew : array of shape (n,)
        Outside these freedoms.
    """

    landed: Array
    turned: Array
    off: Array
    askew: Array

    @classmethod
    def unknown(cls, n: int) -> TargetErrors:
        """Create the result of n targets of which nothing is known yet."""
        return cls(*(np.full(n, np.inf) for _ in range(4)))

    def take(
        self,
        rows: NDArray[np.int64],
        arm: Freedoms,
        robot: Robot,
        joints: Array,
        tool: Array,
        reached: Array,
        wanted: Array,
    ) -> tuple[NDArray[np.bool_], Array]:
        """Record the errors of some rows and return whether they have landed, shape (k,).

        The rows are at model angles (k, N) in poses `reached` (k, 4, 4). Also returns the target poses
        (k, 4, 4) without the part that the arm cannot reach.
        """
        miss, goal = pose_difference(wanted, reached), wanted
        within = miss
        if not arm.all:
            scale = np.repeat([1.0, LEVER_MM], 3)
            jacobian = nominal_jacobian(robot, joints, tool)[1]
            within = arm.step(jacobian, miss * scale)[1] / scale
            goal = reached.copy()
            goal[:, :3, 3] += within[:, :3]
            goal[:, :3, :3] = Rotation.from_rotvec(within[:, 3:]).as_matrix() @ goal[:, :3, :3]
        for into, part in (
            (self.landed, within[:, :3]),
            (self.turned, within[:, 3:]),
            (self.off, (miss - within)[:, :3]),
            (self.askew, (miss - within)[:, 3:]),
        ):
            into[rows] = np.linalg.norm(part, axis=1)
        return (self.landed[rows] <= LANDED_MM) & (self.turned[rows] <= LANDED_RAD), goal

    def correction(
        self,
        joints: Array,
        refusals: Sequence[tuple[Status, NDArray[np.bool_]]],
        iterations: NDArray[np.int64],
        arm: Freedoms,
    ) -> Correction:
        """Build the correction to `joints` (n, N), with the rows that are refused, by reason."""
        left = ResidualError(self.off, self.askew, tilt=arm.turns == 1)
        return Correction.of(joints, refusals, self.landed, self.turned, left, iterations)
