"""Axis 1 square to axis 2, axis 3 parallel to it: what all jointed arms have before their wrists.

With E = (z_1 x z_2, z_1, z_2) at the zero pose every rotation of the first three joints is a rotation in a plane.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.inverse_kinematics.columns import Mask, Vector
from calib.arm.inverse_kinematics.solutions import SINGULAR_SINE
from calib.arm.inverse_kinematics.zero_pose import MEETING_MM, ZeroPose
from calib.array import Array

ROUNDING = 1e-12
"""Relative: by so much a cosine may exceed one in a pose just reached, and a sine be zero that leaves a joint free."""

# The axes of the branches come first, then the poses: (front, up, ..., n).
FRONT = np.array([1.0, -1.0]).reshape(2, 1, 1, 1)
UP = np.array([1.0, -1.0]).reshape(1, 2, 1, 1)


@dataclass(frozen=True)
class TwoLinks:
    """Shoulder, upper arm and forearm at the zero pose; vectors (3,), mm.

    base: rows z_1 x z_2, z_1, z_2. origin: a point of axis 1. offset: from it to axis 2, in the axes E. upper_arm,
    forearm: from axis 2 to 3 and from axis 3 to the end of the forearm, in the plane across axis 2, as angle and
    length, rad and mm. front: sign of the reach at the zero pose. across: mm by which the centre, which only the first
    three joints carry across, lies off the plane through axis 1 that axis 2 is square to.
    """

    base: Array
    origin: Array
    offset: Array
    upper_arm: tuple[float, float]
    forearm: tuple[float, float]
    front: float
    across: float

    @classmethod
    def of(cls, zero: ZeroPose, centre: Array, end: Array) -> TwoLinks:
        """Raises DataError where two of the axes coincide."""
        axes, points = zero.axes, zero.points
        base = np.stack([np.cross(axes[0], axes[1]), axes[0], axes[1]])
        upper_arm, forearm = (_polar(base @ span) for span in (points[2] - points[1], end - points[2]))
        if min(upper_arm[1], forearm[1]) <= MEETING_MM:
            raise zero.refused("two of the axes 2, 3 and 4 coincide")
        reach = float(base[0] @ (centre - points[0]))
        return cls(
            base=base,
            origin=points[0],
            offset=base @ (points[1] - points[0]),
            upper_arm=upper_arm,
            forearm=forearm,
            front=-1.0 if reach < -MEETING_MM else 1.0,
            across=float(base[2] @ (centre - points[0])),
        )

    def shoulder(self, centre: Vector, free: Array) -> tuple[Array, Mask, Mask]:
        """theta_1 (2, 1, 1, n); where the pose is too near to axis 1; where the centre lies above it.

        centre: from `origin` in the axes E. free: theta_1 where it is not determined.
        """
        size = np.hypot(centre[0], centre[2])
        short = (size - abs(self.across)) * (size + abs(self.across))
        scale = self.upper_arm[1] + self.forearm[1]
        near = short < -ROUNDING * scale**2
        reach = FRONT * self.front * np.sqrt(np.maximum(short, 0.0))
        theta_1 = np.arctan2(centre[0], centre[2]) - np.arctan2(reach, self.across)
        above = np.abs(reach) < SINGULAR_SINE * scale
        undetermined = size < ROUNDING * scale
        return np.where(undetermined, free, theta_1), near, above & ~near

    def from_axis_2(self, point: Vector) -> tuple[Array, Array]:
        """A point given from `origin` in the axes E, as seen from axis 2 in the plane across it."""
        return point[0] - self.offset[0], point[1] - self.offset[1]

    def elbow(self, end: tuple[Array, Array]) -> tuple[Array, Array, Mask, Mask]:
        """theta_2 and the turn of forearm against upper arm; where that is out of reach; where stretched."""
        (angle_upper, upper), (angle_fore, fore) = self.upper_arm, self.forearm
        between, lead, far, stretched = bent(end, upper, fore, UP)
        theta_2 = np.arctan2(end[1], end[0]) - lead - angle_upper
        return theta_2, between - angle_fore + angle_upper, far, stretched


def bent(end: tuple[Array, Array], upper: float, fore: float, sign: Array) -> tuple[Array, Array, Mask, Mask]:
    """Two links of lengths `upper` and `fore`, mm, that end at a point of their plane.

    Angles from upper to fore, with the sign asked for, and from upper to the end; where it is out of reach; where
    the links are in line.
    """
    x, y = end
    cosine = (x * x + y * y - upper * upper - fore * fore) / (2.0 * upper * fore)
    far = np.abs(cosine) > 1.0 + ROUNDING
    sine = sign * np.sqrt(np.maximum((1.0 - cosine) * (1.0 + cosine), 0.0))
    between = np.arctan2(sine, cosine)
    lead = np.arctan2(fore * sine, upper + fore * cosine)
    return between, lead, far, (np.abs(sine) < SINGULAR_SINE) & ~far


def _polar(in_base: Array) -> tuple[float, float]:
    """Angle and length of a vector in the plane across axis 2, from its components in the axes E."""
    return float(np.arctan2(in_base[1], in_base[0])), float(np.hypot(in_base[0], in_base[1]))
