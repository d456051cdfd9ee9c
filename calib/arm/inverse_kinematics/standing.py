"""An arm on a track, a column or a turntable: the external axis stays where the seed has it, and the arm is solved.

The pose is transformed back by the motion of the external axis; what is left is an arm with a known solution.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.inverse_kinematics.arm import Arm
from calib.arm.inverse_kinematics.solutions import Solutions
from calib.arm.inverse_kinematics.zero_pose import ZeroPose
from calib.array import Array


@dataclass(frozen=True)
class Standing:
    """An arm, and the first axis of its zero pose, which carries it."""

    zero: ZeroPose
    arm: Arm

    @property
    def kind(self) -> str:
        """The kind of the arm, and that joint 1 is not solved for."""
        return f"{self.arm.kind}; joint 1 stays where it stands"

    @property
    def branches(self) -> tuple[str, ...]:
        """The branches of the arm."""
        return self.arm.branches

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """All branches of the arm for flange poses (n, 4, 4), mm; seed (n, N): its first column is the position of
        the external axis."""
        moved = self.zero.moved(0, seed[:, 0])
        back = np.zeros_like(moved)
        back[:, :3, :3] = moved[:, :3, :3].transpose(0, 2, 1)
        back[:, :3, 3:] = -back[:, :3, :3] @ moved[:, :3, 3:]
        back[:, 3, 3] = 1.0
        found = self.arm.solve(back @ poses, seed[:, 1:])
        stands = np.where(found.valid, seed[:, :1], np.nan)
        return Solutions(
            np.concatenate([stands[:, :, None], found.joints], axis=2), found.state, found.branches
        )
