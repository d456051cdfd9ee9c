"""The remaining error of a corrected pose: the part that the arm could correct, and the part that it cannot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arm.freedoms import Freedoms
from calib.arm.jacobian import LEVER_MM, nominal_jacobian, pose_difference
from calib.arm.robot import Robot
from calib.array import Array
from calib.compensate.correction import Correction, Left, Status

LANDED_MM, LANDED_RAD = 1e-7, 1e-9


@dataclass(frozen=True)
class Misses:
    """Misses of n targets, mm and rad, infinite where not known.

    landed, turned: (n,) within the freedoms of the arm. off, askew: (n,) what it cannot move or turn.
    """

    landed: Array
    turned: Array
    off: Array
    askew: Array

    @classmethod
    def unknown(cls, n: int) -> Misses:
        """n targets of which nothing is known yet."""
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
        """Keep what some rows, at model angles (k, N) in poses `reached` (k, 4, 4), miss of those `wanted`.

        Returns (k,) whether they have landed, and (k, 4, 4) the wanted poses without what the arm cannot do.
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
        """The correction to `joints` (n, N), with the rows that are refused, by reason."""
        left = Left(self.off, self.askew, tilt=arm.turns == 1)
        return Correction.of(joints, refusals, self.landed, self.turned, left, iterations)
