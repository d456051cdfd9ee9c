"""Six axes in closed form: every pose in all its branches at once.

With E = (z_1 x z_2, z_1, z_2) at the zero pose every rotation of the arm is a rotation in a plane. The
angles follow in this order:

    shoulder   w = T M^-1 w_0;   z_2 . R_1^-1 (w - o_1) = const   gives theta_1, front and back
    elbow      |p|^2 = |l|^2 + |f|^2 + 2 |l| |f| cos(theta_3 + phi)   gives theta_3, up and down, then theta_2
    wrist      v = R z_6 = cos(psi) z_4 + sin(psi) (cos(theta_4) z_5 x z_4 + sin(theta_4) z_5)
               gives theta_4 and psi = theta_5 + tilt, noflip and flip, then theta_6

A spherical wrist takes the elbow first, with p the wrist centre. With three parallel axes the wrist
comes first, theta_4 being the sum of the three, and p is where axis 4 then lies.

The structure of an arm is found from where its axes lie at the zero pose of the nominal chain, for any
convention of its parameters. The directions and points of the joint axes are z_i and o_i. Two kinds are
known:

    spherical wrist   axes 2 and 3 parallel; axes 4, 5, 6 meet in one point, the wrist centre w
    parallel elbow    axes 2, 3 and 4 parallel; axes 5 and 6 meet in w (the UR family)

In both, axis 1 is square to axis 2, axis 4 to axis 5 and axis 5 to axis 6.

Sources: Pieper 1968 (both kinds are his solvable ones) and Paden 1986 (the sub-problems). Hawkins 2013
(the order for the UR arms). Murray, Li, Sastry 1994, section 3.2 (axes at the zero pose instead of DH
numbers).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.arm.inverse_kinematics.solutions import BRANCHES, BranchResult, Solutions, columns, turn_back
from calib.arm.inverse_kinematics.turns import TwoLinks, axes_of_turns, three_turns, tilt_of
from calib.arm.inverse_kinematics.zero_pose import MEETING_MM, SQUARE, ZeroPose, meeting, parallel
from calib.array import Array

Kind = Literal["spherical wrist", "parallel elbow"]


@dataclass(frozen=True)
class ArmStructure:
    """Zero pose of six axes that can be inverted; vectors (3,) in the base frame, mm.

    Attributes
    ----------
    centre : array of shape (3,)
        The wrist centre w.
    links : TwoLinks
        The first three axes.
    wrist : array of shape (3, 3)
        Rows z_5 x z_4, z_5, z_4.
    tilt : float
        Angle of z_6 from z_4 about z_5, rad.
    senses : tuple of float
        +1 or -1 if axes 3 and 4 point along axis 2 or against it.
    """

    kind: Kind
    zero: ZeroPose
    centre: Array
    links: TwoLinks
    wrist: Array
    tilt: float
    senses: tuple[float, float]


def structure_of(zero: ZeroPose) -> ArmStructure:
    """Find the structure of an arm of six axes.

    Raises
    ------
    DataError
        The arm is of neither kind; the message states which condition fails.
    """
    if zero.joints != 6 or not all(zero.turns):
        raise zero.refused(f"it has {zero.joints} joints, of which {sum(zero.turns)} turn, not 6")
    axes, points = zero.axes, zero.points
    for one, other in ((1, 2), (4, 5), (5, 6)):
        off = float(abs(axes[one - 1] @ axes[other - 1]))
        if off > SQUARE:
            angle = np.degrees(np.arccos(min(off, 1.0)))
            raise zero.refused(f"axes {one} and {other} are at {angle:.3f} deg, not square")
    if not parallel(axes[1], axes[2]):
        raise zero.refused("axes 2 and 3 are not parallel")
    centre, gap = meeting(points[4], axes[4], points[5], axes[5])
    if gap > MEETING_MM:
        raise zero.refused(f"axes 5 and 6 pass each other at {gap:.6g} mm")
    from_4 = centre - points[3]
    off_4 = float(np.linalg.norm(from_4 - (from_4 @ axes[3]) * axes[3]))
    kind: Kind
    if off_4 <= MEETING_MM:
        kind, end = "spherical wrist", centre
    elif parallel(axes[1], axes[3]):
        kind, end = "parallel elbow", points[3]
    else:
        raise zero.refused(
            f"axis 4 passes the wrist centre at {off_4:.6g} mm and is not parallel to axes 2 and 3",
        )
    wrist = axes_of_turns(axes[3], axes[4])
    return ArmStructure(
        kind=kind,
        zero=zero,
        centre=centre,
        links=TwoLinks.of(zero, centre, end),
        wrist=wrist,
        tilt=tilt_of(wrist, axes[5]),
        senses=(float(np.sign(axes[1] @ axes[2])), float(np.sign(axes[1] @ axes[3]))),
    )


_NOFLIP = np.array([1.0, -1.0]).reshape(1, 1, 2, 1)


@dataclass(frozen=True)
class SixAxes:
    """Six axes of a structure with a closed form."""

    structure: ArmStructure

    branches = BRANCHES

    @property
    def kind(self) -> str:
        """The structure of the arm, solved in closed form."""
        return f"in closed form, {self.structure.kind}"

    @classmethod
    def of(cls, zero: ZeroPose) -> SixAxes:
        """Find the structure of an arm from its zero pose.

        Raises
        ------
        DataError
            The arm has another structure; the message states which condition fails.
        """
        return cls(structure_of(zero))

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """Solve all eight branches of flange poses (n, 4, 4), base frame, mm.

        `seed` (n, 6), rad, gives the joints that a singular pose does not determine.
        """
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
                (BranchResult.WRIST, in_line),
                (BranchResult.ELBOW, stretched),
                (BranchResult.SHOULDER, above),
                (BranchResult.TOO_FAR, far),
                (BranchResult.TOO_NEAR, near),
            ),
            arm.zero.turns,
            n,
        )
