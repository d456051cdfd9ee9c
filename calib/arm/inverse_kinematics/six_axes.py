"""Six axes in closed form: every pose in all its branches at once.

With E = (z_1 x z_2, z_1, z_2) at the zero pose every rotation of the arm is a rotation in a plane. In turn:

    shoulder   w = T M^-1 w_0;   z_2 . R_1^-1 (w - o_1) = const   gives theta_1, front and back
    elbow      |p|^2 = |l|^2 + |f|^2 + 2 |l| |f| cos(theta_3 + phi)   gives theta_3, up and down, then theta_2
    wrist      v = R z_6 = cos(psi) z_4 + sin(psi) (cos(theta_4) z_5 x z_4 + sin(theta_4) z_5)
               gives theta_4 and psi = theta_5 + tilt, noflip and flip, then theta_6

A spherical wrist takes the elbow first, with p the wrist centre. With three parallel axes the wrist comes first,
theta_4 being the sum of the three, and p is where axis 4 then lies. Sources: Pieper 1968; Paden 1986 (the
sub-problems); Hawkins 2013 (the order for the UR arms).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.inverse_kinematics.columns import columns, turn_back
from calib.arm.inverse_kinematics.solutions import BRANCHES, Reached, Solutions
from calib.arm.inverse_kinematics.structure import Structure, structure_of
from calib.arm.inverse_kinematics.three_turns import three_turns
from calib.arm.inverse_kinematics.zero_pose import ZeroPose
from calib.array import Array

_NOFLIP = np.array([1.0, -1.0]).reshape(1, 1, 2, 1)


@dataclass(frozen=True)
class SixAxes:
    """Six axes of a structure with a closed form."""

    structure: Structure

    branches = BRANCHES

    @property
    def kind(self) -> str:
        """The structure of the arm, solved in closed form."""
        return f"in closed form, {self.structure.kind}"

    @classmethod
    def of(cls, zero: ZeroPose) -> SixAxes:
        """Raises DataError, saying what prevents it, for other arms."""
        return cls(structure_of(zero))

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """All eight branches of flange poses (n, 4, 4), base frame, mm; seed (n, 6) rad for joints left free."""
        arm = self.structure
        n, links, flange, seed = len(poses), arm.links, arm.zero.flange, seed.T
        # What the arm as a whole turns: zero pose -> wanted pose, in the axes E.
        turned = links.base @ poses[:, :3, :3] @ flange[:3, :3].T
        in_flange = flange[:3, :3].T @ (arm.centre - flange[:3, 3])
        centre = columns((poses[:, :3, 3] + poses[:, :3, :3] @ in_flange - links.origin) @ links.base.T)
        axis_6, axis_5 = columns(turned @ arm.zero.axes[5]), columns(turned @ arm.zero.axes[4])
        to_wrist = arm.wrist @ links.base.T

        theta_1, near, above = links.shoulder(centre, seed[0])
        centre, axis_6, axis_5 = (turn_back(v, theta_1, (2, 0)) for v in (centre, axis_6, axis_5))
        s3, s4 = arm.senses
        if arm.kind == "spherical wrist":
            theta_2, bent, far, stretched = links.elbow(links.from_axis_2(centre))
            arm_turn = theta_2 + bent
            axis_6, axis_5 = (turn_back(v, arm_turn, (0, 1)) for v in (axis_6, axis_5))
            theta_4, theta_5, theta_6, in_line = three_turns(
                to_wrist, arm.tilt, axis_6, axis_5, _NOFLIP, seed[3]
            )
        else:
            free = s4 * (seed[1] + s3 * seed[2]) + seed[3]
            turn_4, theta_5, theta_6, in_line = three_turns(to_wrist, arm.tilt, axis_6, axis_5, _NOFLIP, free)
            hand = links.base @ (arm.centre - arm.zero.points[3])
            angle = s4 * turn_4
            from_4 = (
                np.cos(angle) * hand[0] - np.sin(angle) * hand[1],
                np.sin(angle) * hand[0] + np.cos(angle) * hand[1],
            )
            x, y = links.from_axis_2(centre)
            theta_2, bent, far, stretched = links.elbow((x - from_4[0], y - from_4[1]))
            theta_4 = turn_4 - s4 * (theta_2 + bent)
        angles = (theta_1, theta_2, s3 * bent, theta_4, theta_5, theta_6)

        return Solutions.of(
            BRANCHES,
            angles,
            (  # the weightiest last: it is the one that is kept
                (Reached.WRIST, in_line),
                (Reached.ELBOW, stretched),
                (Reached.SHOULDER, above),
                (Reached.TOO_FAR, far),
                (Reached.TOO_NEAR, near),
            ),
            arm.zero.turns,
            n,
        )
