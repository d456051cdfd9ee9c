"""The structures of arms that can be inverted in closed form, found from where their axes lie, whatever the convention.

From the zero pose of the nominal chain: directions z_i and points o_i of the joint axes. Two kinds are known:

    spherical wrist   axes 2 and 3 parallel; axes 4, 5, 6 meet in one point, the wrist centre w
    parallel elbow    axes 2, 3 and 4 parallel; axes 5 and 6 meet in w (the UR family)

In both axis 1 is square to axis 2, axis 4 to axis 5 and axis 5 to axis 6. Source: Pieper 1968 (both are his
solvable kinds); Murray, Li, Sastry 1994, section 3.2 (axes at the zero pose instead of DH numbers).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.arm.inverse_kinematics.three_turns import axes_of_turns, tilt_of
from calib.arm.inverse_kinematics.two_links import TwoLinks
from calib.arm.inverse_kinematics.zero_pose import MEETING_MM, SQUARE, ZeroPose, meeting, parallel
from calib.array import Array

Kind = Literal["spherical wrist", "parallel elbow"]


@dataclass(frozen=True)
class Structure:
    """The zero pose of six axes that can be inverted; vectors (3,) in the base frame, mm.

    centre: the wrist centre w. links: the first three axes. wrist: rows z_5 x z_4, z_5, z_4. tilt: angle of z_6 from
    z_4 about z_5, rad. senses: +1 or -1 as axes 3 and 4 point along axis 2 or against it.
    """

    kind: Kind
    zero: ZeroPose
    centre: Array
    links: TwoLinks
    wrist: Array
    tilt: float
    senses: tuple[float, float]


def structure_of(zero: ZeroPose) -> Structure:
    """The structure of six axes. Raises DataError, saying what prevents it, when it is of neither kind."""
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
    return Structure(
        kind=kind,
        zero=zero,
        centre=centre,
        links=TwoLinks.of(zero, centre, end),
        wrist=wrist,
        tilt=tilt_of(wrist, axes[5]),
        senses=(float(np.sign(axes[1] @ axes[2])), float(np.sign(axes[1] @ axes[3]))),
    )
