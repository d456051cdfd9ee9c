"""Three axes that turn a tool about a point, each square to the next: a wrist, or the shoulder of seven axes."""

from __future__ import annotations

import numpy as np

from calib.arm.inverse_kinematics.columns import Mask, Vector, in_axes
from calib.arm.inverse_kinematics.solutions import SINGULAR_SINE
from calib.arm.inverse_kinematics.two_links import ROUNDING
from calib.array import Array


def axes_of_turns(first: Array, middle: Array) -> Array:
    """(3, 3) rows middle x first, middle, first: the axes in which `three_turns` reckons."""
    return np.stack([np.cross(middle, first), middle, first])


def tilt_of(rows: Array, last: Array) -> float:
    """Angle of the last axis from the first about the middle one at the zero pose, rad."""
    return float(np.arctan2(last @ rows[0], last @ rows[2]))


def three_turns(
    rows: Array, tilt: float, last: Vector, middle: Vector, sign: Array, free: Array
) -> tuple[Array, Array, Array, Mask]:
    """The three angles, from where they have turned the last and the middle axis of the zero pose; where singular.

    sign: +1 or -1, the side to which the last axis turns from the first. free: the first angle where first and last
    axis are in line.
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
