"""The structures of arms that can be inverted in closed form, found from where their axes lie, whatever the convention.

From the zero pose of the nominal chain: directions z_i and points o_i of the joint axes. Two kinds are known:

    spherical wrist   axes 2 and 3 parallel; axes 4, 5, 6 meet in one point, the wrist centre w
    parallel elbow    axes 2, 3 and 4 parallel; axes 5 and 6 meet in w (the UR family)

In both axis 1 is square to axis 2, axis 4 to axis 5 and axis 5 to axis 6. Source: Pieper 1968 (both are his
solvable kinds); Murray, Li, Sastry 1994, section 3.2 (axes at the zero pose instead of DH numbers).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np

from calib.arm.kinematics import Chain, Placement, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array
from calib.errors import DataError

Kind = Literal["spherical wrist", "parallel elbow"]

SQUARE = 1e-9  # cosine or sine that counts as none
MEETING_MM = 1e-7


@dataclass(frozen=True)
class Structure:
    """The zero pose of an arm that can be inverted; vectors (3,) in the base frame, mm.

    base: rows z_1 x z_2, z_1, z_2. wrist: rows z_5 x z_4, z_5, z_4. tilt: angle of z_6 from z_4 about z_5, rad.
    senses: +1 or -1 as axes 3 and 4 point along axis 2 or against it. plane: from axis 2 to 3 and from axis 3 to
    the end of the forearm, in the plane across axis 2, as angle and length, rad and mm. front: sign of the reach
    at the zero pose. across: mm by which w lies off the plane through axis 1 that axis 2 is square to.
    """

    kind: Kind
    axes: Array  # (6, 3) directions
    points: Array  # (6, 3)
    flange: Array  # (4, 4) at the zero pose
    centre: Array  # (3,) the wrist centre w
    base: Array
    wrist: Array
    tilt: float
    senses: tuple[float, float]
    upper_arm: tuple[float, float]
    forearm: tuple[float, float]
    front: float
    across: float


def structure_of(robot: Robot) -> Structure:
    """The structure of a nominal robot. Raises DataError, saying what prevents it, when it is of neither kind."""
    if robot.joints != 6:
        raise _refused(robot, f"it has {robot.joints} joints, not 6")
    frames = propagate(Chain.of(robot), nominal_values(robot, np.zeros((1, 6))), Placement())
    axes = np.stack([_column(frames.axis, k) for k in range(6)])
    points = np.stack([_column(frames.origin, k) for k in range(6)])
    flange = np.eye(4)
    flange[:3, :3], flange[:3, 3] = frames.rotation[0], np.broadcast_to(frames.p, (3, 1))[:, 0]
    for one, other in ((1, 2), (4, 5), (5, 6)):
        off = float(abs(axes[one - 1] @ axes[other - 1]))
        if off > SQUARE:
            angle = np.degrees(np.arccos(min(off, 1.0)))
            raise _refused(robot, f"axes {one} and {other} are at {angle:.3f} deg, not square")
    if not _parallel(axes[1], axes[2]):
        raise _refused(robot, "axes 2 and 3 are not parallel")
    centre, gap = _meeting(points[4], axes[4], points[5], axes[5])
    if gap > MEETING_MM:
        raise _refused(robot, f"axes 5 and 6 pass each other at {gap:.6g} mm")
    from_4 = centre - points[3]
    off_4 = float(np.linalg.norm(from_4 - (from_4 @ axes[3]) * axes[3]))
    kind: Kind
    if off_4 <= MEETING_MM:
        kind, end = "spherical wrist", centre
    elif _parallel(axes[1], axes[3]):
        kind, end = "parallel elbow", points[3]
    else:
        raise _refused(
            robot,
            f"axis 4 passes the wrist centre at {off_4:.6g} mm and is not parallel to axes 2 and 3",
        )
    base = np.stack([np.cross(axes[0], axes[1]), axes[0], axes[1]])
    wrist = np.stack([np.cross(axes[4], axes[3]), axes[4], axes[3]])
    upper_arm, forearm = (_polar(base @ span) for span in (points[2] - points[1], end - points[2]))
    if min(upper_arm[1], forearm[1]) <= MEETING_MM:
        raise _refused(robot, "two of the axes 2, 3 and 4 coincide")
    reach = float(base[0] @ (centre - points[0]))
    return Structure(
        kind=kind,
        axes=axes,
        points=points,
        flange=flange,
        centre=centre,
        base=base,
        wrist=wrist,
        tilt=float(np.arctan2(axes[5] @ wrist[0], axes[5] @ wrist[2])),
        senses=(float(np.sign(axes[1] @ axes[2])), float(np.sign(axes[1] @ axes[3]))),
        upper_arm=upper_arm,
        forearm=forearm,
        front=-1.0 if reach < -MEETING_MM else 1.0,
        across=float(base[2] @ (centre - points[0])),
    )


def _column(by_slot: Mapping[str, Array], k: int) -> Array:
    return np.broadcast_to(by_slot[f"theta{k + 1}"], (3, 1))[:, 0]


def _parallel(one: Array, other: Array) -> bool:
    return float(np.linalg.norm(np.cross(one, other))) <= SQUARE


def _polar(in_base: Array) -> tuple[float, float]:
    """Angle and length of a vector in the plane across axis 2, from its components along `Structure.base`."""
    return float(np.arctan2(in_base[1], in_base[0])), float(np.hypot(in_base[0], in_base[1]))


def _meeting(p: Array, u: Array, q: Array, v: Array) -> tuple[Array, float]:
    """Where two lines that are square to each other come closest: the point on the first, and the gap, mm."""
    at = p + ((q - p) @ u) * u
    off = q - at
    return at, float(np.linalg.norm(off - (off @ v) * v))


def _refused(robot: Robot, why: str) -> DataError:
    return DataError(
        f"the robot '{robot.name}' has no inverse kinematics in closed form here: {why}.",
        do="Arms with a spherical wrist or with three parallel axes (UR) have one; for others give joint targets.",
        key="robot",
    )
