"""Whole turns of joints within limits, the branch near a seed, and parts of jointed arms.

The angles may be a model's or a controller's: joint matrices of whole numbers carry whole turns into
whole turns.

`three_turns` solves three axes that turn a tool about a point, each square to the next: a wrist, or the
shoulder of seven axes. `TwoLinks` describes axis 1 square to axis 2 and axis 3 parallel to it, which all
jointed arms have before their wrists.

With E = (z_1 x z_2, z_1, z_2) at the zero pose every rotation of the first three joints is a rotation in
a plane.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.arm.inverse_kinematics.solutions import SINGULAR_SINE, Mask, Vector, in_axes
from calib.arm.inverse_kinematics.zero_pose import MEETING_MM, ZeroPose
from calib.array import Array

TURN = 2.0 * np.pi
EDGE = 1e-9  # rad: an angle on the limit itself is within it
ROUNDING = 1e-12
"""Relative: by so much a cosine may exceed one in a pose just reached, and a sine be zero that leaves a joint free."""

# The axes of the branches come first, then the poses: (front, up, ..., n).
FRONT = np.array([1.0, -1.0]).reshape(2, 1, 1, 1)
UP = np.array([1.0, -1.0]).reshape(1, 2, 1, 1)


def nearest_turns(
    angles: Array, seed: Array, lower: Array, upper: Array, *, slides: Sequence[int] = ()
) -> Array:
    """Choose the whole turn of every angle within its limits that is nearest to a seed.

    Parameters
    ----------
    angles : array of shape (..., N)
        Joints, rad or mm.
    seed : array of shape (..., N)
        Broadcast against `angles`.
    lower, upper : array of shape (N,)
        Limits.
    slides : sequence of int, optional
        Numbers of joints, from 1, that slide and so have no turns.

    Returns
    -------
    array of shape (..., N)
        NaN if no turn lies within the limits.
    """
    first = np.ceil((lower - EDGE - angles) / TURN)
    last = np.floor((upper + EDGE - angles) / TURN)
    wanted = np.round((seed - angles) / TURN)
    for k in slides:
        inside = (lower[k - 1] - EDGE <= angles[..., k - 1]) & (angles[..., k - 1] <= upper[k - 1] + EDGE)
        first[..., k - 1], last[..., k - 1], wanted[..., k - 1] = 0.0, np.where(inside, 0.0, -1.0), 0.0
    turned = angles + TURN * np.clip(wanted, first, last)
    return np.where(first <= last, turned, np.nan)


def within_limits(
    angles: Array, seed: Array, lower: Array, upper: Array, *, slides: Sequence[int] = ()
) -> Array:
    """Choose turns as `nearest_turns` does, but set a configuration to NaN as a whole.

    This happens if one of its joints has no turn within its limits.
    """
    turned = nearest_turns(angles, seed, lower, upper, slides=slides)
    return np.where(np.all(np.isfinite(turned), axis=-1, keepdims=True), turned, np.nan)


def nearest_branch(configurations: Array, seed: Array) -> NDArray[np.int64]:
    """Choose the configuration nearest to a seed (n, N) for each pose, shape (n,).

    `configurations` (n, branches, N) are NaN if there is none. Nearest means the smallest sum of squared
    joint differences; the index is -1 if all are NaN. `seed` may have the shape (N,), for all poses.
    """
    away = np.sum((configurations - np.expand_dims(seed, -2)) ** 2, axis=-1)
    away = np.where(np.isfinite(away), away, np.inf)
    best = np.argmin(away, axis=-1)
    return np.where(np.isfinite(np.min(away, axis=-1)), best, -1)


def axes_of_turns(first: Array, middle: Array) -> Array:
    """Build the axes in which `three_turns` calculates: rows middle x first, middle, first."""
    return np.stack([np.cross(middle, first), middle, first])


def tilt_of(rows: Array, last: Array) -> float:
    """Angle of the last axis from the first about the middle one at the zero pose, rad."""
    return float(np.arctan2(last @ rows[0], last @ rows[2]))


def three_turns(
    rows: Array, tilt: float, last: Vector, middle: Vector, sign: Array, free: Array
) -> tuple[Array, Array, Array, Mask]:
    """Compute the angles of three axes from where they have turned two axes of the zero pose.

    Parameters
    ----------
    rows : array of shape (3, 3)
        Axes from `axes_of_turns`.
    tilt : float
        Angle from `tilt_of`, rad.
    last, middle : tuple of array
        Components of the last and the middle axis after the turns.
    sign : array
        +1 or -1, the side to which the last axis turns from the first.
    free : array
        The first angle to use if the first and the last axis are in line.

    Returns
    -------
    first, second, third : array
        The angles, rad.
    singular : array of bool
        Whether the first and the last axis are in line.
    """
    x, y, z = in_axes(rows, last)
    across = np.hypot(x, y)
    first = np.where(across < ROUNDING, free, np.arctan2(sign * y, sign * x))
    psi = np.arctan2(sign * across, z)
    c, s = np.cos(first), np.sin(first)
    rx, ry, rz = in_axes(rows, middle)
    rx, ry = c * rx + s * ry, c * ry - s * rx
    third = np.arctan2(np.sin(psi) * rz - np.cos(psi) * rx, ry)
    return first, psi - tilt, third, across < SINGULAR_SINE


@dataclass(frozen=True)
class TwoLinks:
    """Shoulder, upper arm and forearm at the zero pose; vectors (3,), mm.

    Attributes
    ----------
    base : array of shape (3, 3)
        Rows z_1 x z_2, z_1, z_2: the axes E.
    origin : array of shape (3,)
        A point of axis 1.
    offset : array of shape (3,)
        From `origin` to axis 2, in the axes E.
    upper_arm, forearm : tuple of float
        Angle, rad, and length, mm, in the plane across axis 2: from axis 2 to axis 3, and from axis 3 to
        the end of the forearm.
    front : float
        Sign of the reach at the zero pose.
    across : float
        Distance of the centre from the plane through axis 1 that is square to axis 2, mm. Only the first
        three joints move the centre across this plane.
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
        """Build the links of a zero pose.

        Raises
        ------
        DataError
            Two of the axes 2, 3 and 4 coincide.
        """
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
        """Compute theta_1, shape (2, 1, 1, n), from the centre.

        Parameters
        ----------
        centre : tuple of array
            Components from `origin` in the axes E.
        free : array
            theta_1 to use if the pose does not determine it.

        Returns
        -------
        theta_1 : array
            Angle, rad.
        near : array of bool
            Whether the pose is too near to axis 1.
        above : array of bool
            Whether the centre lies above axis 1.
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
        """Express a point from `origin` in the axes E relative to axis 2, in the plane across it."""
        return point[0] - self.offset[0], point[1] - self.offset[1]

    def elbow(self, end: tuple[Array, Array]) -> tuple[Array, Array, Mask, Mask]:
        """Compute theta_2 and the turn of the forearm against the upper arm.

        Also returns whether the end is out of reach, and whether the arm is stretched or folded.
        """
        (angle_upper, upper), (angle_fore, fore) = self.upper_arm, self.forearm
        between, lead, far, stretched = bent(end, upper, fore, UP)
        theta_2 = np.arctan2(end[1], end[0]) - lead - angle_upper
        return theta_2, between - angle_fore + angle_upper, far, stretched


def bent(end: tuple[Array, Array], upper: float, fore: float, sign: Array) -> tuple[Array, Array, Mask, Mask]:
    """Solve two links of lengths `upper` and `fore`, mm, that end at a point of their plane.

    Returns the angle from upper to fore, which has the given sign, and the angle from upper to the end.
    Two masks follow: whether the end is out of reach, and whether the links are in line.
    """
    x, y = end
    cosine = (x * x + y * y - upper * upper - fore * fore) / (2.0 * upper * fore)
    far = np.abs(cosine) > 1.0 + ROUNDING
    sine = sign * np.sqrt(np.maximum((1.0 - cosine) * (1.0 + cosine), 0.0))
    between = np.arctan2(sine, cosine)
    lead = np.arctan2(fore * sine, upper + fore * cosine)
    return between, lead, far, (np.abs(sine) < SINGULAR_SINE) & ~far


def _polar(in_base: Array) -> tuple[float, float]:
    """Return angle and length of a vector in the plane across axis 2.

    `in_base` are its components in the axes E.
    """
    return float(np.arctan2(in_base[1], in_base[0])), float(np.hypot(in_base[0], in_base[1]))
