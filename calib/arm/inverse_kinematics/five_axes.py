"""Five axes that turn: axis 1, three parallel ones square to it, and one square to those. A palletizer is one of them.

The last axis has to lie in the plane of the arm. A palletizer keeps it level by rods, which its joint matrix says; of
poses that ask for that, the closed form finds the joints that the rods lead to. In turn, in the axes E of
`two_links`:

    shoulder   w, where axis 5 comes closest to axis 4, gives theta_1, front and back
    turn       angle of R z_5 in the plane of the arm = theta_2 + theta_3 + theta_4 (each by its sense)
    elbow      axis 4, as seen from axis 2, gives theta_3, up and down, then theta_2
    last       theta_5 from where axis 4 then points
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.inverse_kinematics.solutions import WITHOUT_WRIST, BranchResult, Solutions, columns, turn_back
from calib.arm.inverse_kinematics.turns import TwoLinks
from calib.arm.inverse_kinematics.zero_pose import ZeroPose, meeting, parallel, square
from calib.array import Array

LEVEL = 1e-10
"""rad by which axis 5 may leave the plane of the arm: rounding."""


@dataclass(frozen=True)
class FiveAxes:
    """Zero pose of an arm of five axes.

    Attributes
    ----------
    centre : array of shape (3,)
        The centre w, mm, in the base frame.
    hand, last : array of shape (3,)
        The vector from axis 4 to w, mm, and z_5, both in the axes E.
    senses : tuple of float
        +1 or -1 if axes 3 and 4 point along axis 2 or against it.
    """

    zero: ZeroPose
    links: TwoLinks
    centre: Array
    hand: Array
    last: Array
    senses: tuple[float, float]

    kind = "in closed form, five axes"
    branches = WITHOUT_WRIST

    @classmethod
    def of(cls, zero: ZeroPose) -> FiveAxes:
        """Find the structure of an arm from its zero pose.

        Raises
        ------
        DataError
            The arm has another structure; the message states which condition fails.
        """
        axes, points = zero.axes, zero.points
        if zero.joints != 5 or not all(zero.turns):
            raise zero.refused(f"it has {zero.joints} joints, of which {sum(zero.turns)} turn, not 5")
        for one, other, wanted, fits in (
            (1, 2, "square", square),
            (2, 3, "parallel", parallel),
            (3, 4, "parallel", parallel),
            (4, 5, "square", square),
        ):
            if not fits(axes[one - 1], axes[other - 1]):
                raise zero.refused(f"axes {one} and {other} are not {wanted}")
        centre = meeting(points[4], axes[4], points[3], axes[3])[0]
        links = TwoLinks.of(zero, centre, points[3])
        return cls(
            zero,
            links,
            centre,
            links.base @ (centre - points[3]),
            links.base @ axes[4],
            (float(np.sign(axes[1] @ axes[2])), float(np.sign(axes[1] @ axes[3]))),
        )

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """Solve all four branches of flange poses (n, 4, 4), base frame, mm.

        `seed` (n, 5), rad, gives theta_1 if the pose does not determine it.
        """
        links, flange = self.links, self.zero.flange
        turned = links.base @ poses[:, :3, :3] @ flange[:3, :3].T
        in_flange = flange[:3, :3].T @ (self.centre - flange[:3, 3])
        centre = columns((poses[:, :3, 3] + poses[:, :3, :3] @ in_flange - links.origin) @ links.base.T)
        axis_5, axis_4 = columns(turned @ self.zero.axes[4]), columns(turned @ self.zero.axes[3])
        theta_1, near, above = links.shoulder(centre, seed[:, 0])
        centre, axis_5, axis_4 = (turn_back(v, theta_1, (2, 0)) for v in (centre, axis_5, axis_4))
        tilted = np.abs(axis_5[2]) > LEVEL
        turn = np.arctan2(axis_5[1], axis_5[0]) - np.arctan2(self.last[1], self.last[0])
        c, s = np.cos(turn), np.sin(turn)
        x, y = links.from_axis_2(centre)
        x, y = x - (c * self.hand[0] - s * self.hand[1]), y - (s * self.hand[0] + c * self.hand[1])
        theta_2, between, far, stretched = links.elbow((x, y))
        s3, s4 = self.senses
        # What theta_5 alone has turned of axis 4, against axis 4 and square to it.
        x, y, z = turn_back(axis_4, turn, (0, 1))
        across = np.cross(self.last, [0.0, 0.0, s4])
        theta_5 = np.arctan2(across[0] * x + across[1] * y, s4 * z)
        joints = (theta_1, theta_2, s3 * between, s4 * (turn - theta_2 - between), theta_5)
        states = (
            (BranchResult.ELBOW, stretched),
            (BranchResult.SHOULDER, above),
            (BranchResult.TILTED, tilted),
            (BranchResult.TOO_FAR, far),
            (BranchResult.TOO_NEAR, near),
        )
        return Solutions.of(self.branches, joints, states, self.zero.turns, len(poses))
