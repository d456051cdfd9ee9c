"""The direct kinematics of the ballbar hexapod: the pose of the tool from six legs and the sides of two triangles.

Frame of the base: B1 = 0, B2 on x, B3 in the plane of x and y (y > 0). The tool balls follow one by one
(`calib.arm.hexapod.trilaterated`), each on either side of its triangle: 2 x 2 x 2 assembly modes. Twelve lengths L fix
twelve coordinates x (three of the base, nine of the tool), by |p - q|^2 = L^2 for the two balls of each length, so

    A dx = diag(L) dL,   dx/dL = A^-1 diag(L),   U_x = (dx/dL) U_L (dx/dL)'

is the law of propagation of the GUM with every length in it, those of the base and of the tool included. (The thesis's
Table 3.1 takes t1 and t2 as independent and B2 as exact, and prints other figures for t3: 3.179 where it is 3.359.)
Lengths mm. Source: Nubiola, thesis, section 3.2; JCGM 100 (GUM), 5.2.2.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import product

import numpy as np
from numpy.typing import ArrayLike

from calib.arm.hexapod import trilaterated
from calib.array import Array

LENGTHS = ("b12", "b23", "b31", "r11", "r21", "r31", "r12", "r22", "r23", "t12", "t23", "t31")
"""Order of the twelve lengths: b_ik between base balls, r_ij from B_i to T_j, t_jk between tool balls."""
MODES = np.array(list(product((1.0, -1.0), repeat=3)))
"""(8, 3) signs of the assembly modes: T1 above the base or below it, then the sides of T2 and of T3."""

_ENDS = np.array(
    [
        *((0, 1), (1, 2), (2, 0)),
        *((0, 3), (1, 3), (2, 3), (0, 4), (1, 4), (1, 5)),
        *((3, 4), (4, 5), (5, 3)),
    ]
)
"""(12, 2) the two balls of every length: B1, B2, B3, T1, T2, T3."""
# Of 6 x 3 coordinates, those that the frame of the base does not fix.
_FREE = np.array([3, 6, 7, *range(9, 18)])


@dataclass(frozen=True)
class HexapodPoses:
    """n sets of lengths in m assembly modes; NaN where the legs of a set do not meet, or a triangle does not close.

    base: (n, 3, 3) base balls and tool: (n, m, 3, 3) tool balls, one a row, in the frame of the base, mm; lengths:
    (n, 12) mm, in the order of `LENGTHS`.
    """

    base: Array
    tool: Array
    lengths: Array

    @property
    def frames(self) -> Array:
        """(n, m, 4, 4) frame of the tool triangle: origin T1, x to T2, z normal to the three balls, mm."""
        second, third = (self.tool[..., k, :] - self.tool[..., 0, :] for k in (1, 2))
        x = second / np.linalg.norm(second, axis=-1)[..., None]
        rest = third - np.sum(x * third, axis=-1)[..., None] * x
        y = rest / np.linalg.norm(rest, axis=-1)[..., None]
        frames = np.zeros((*self.tool.shape[:2], 4, 4))
        frames[..., :3, :3] = np.stack([x, y, np.cross(x, y)], axis=-1)
        frames[..., :3, 3], frames[..., 3, 3] = self.tool[..., 0, :], 1.0
        return frames

    def ball_covariance(self, u_mm: ArrayLike) -> Array:
        """(n, m, 9, 9) mm2: covariance of T1, T2, T3; u_mm: standard uncertainty of lengths, (n, 12), (12,) or one."""
        return self._propagated(self._derivative(), u_mm)

    def _derivative(self) -> Array:
        """(n, m, 9, 12) derivative of the tool balls' coordinates by the lengths; NaN where there is no pose."""
        n, m = self.tool.shape[:2]
        balls = np.concatenate([np.broadcast_to(self.base[:, None], (n, m, 3, 3)), self.tool], axis=2)
        span = balls[:, :, _ENDS[:, 0]] - balls[:, :, _ENDS[:, 1]]  # (n, m, 12, 3)
        rows = np.zeros((n, m, 12, 6, 3))
        each = np.arange(12)
        rows[:, :, each, _ENDS[:, 0]] = span
        rows[:, :, each, _ENDS[:, 1]] = -span
        system = rows.reshape(n, m, 12, 18)[..., _FREE]
        good = np.isfinite(system).all(axis=(2, 3))
        solved = np.full((n, m, 12, 12), np.nan)
        lengths = np.broadcast_to(self.lengths[:, None], (n, m, 12))[good]
        solved[good] = np.linalg.solve(system[good], lengths[:, None, :] * np.eye(12))
        return solved[:, :, 3:]

    @staticmethod
    def _propagated(derivative: Array, u_mm: ArrayLike) -> Array:
        u = np.broadcast_to(np.asarray(u_mm, dtype=np.float64), (len(derivative), 12))
        scaled = derivative * u[:, None, None, :]
        return scaled @ scaled.swapaxes(-1, -2)


def solve_pose(lengths_mm: ArrayLike, modes: ArrayLike = MODES) -> HexapodPoses:
    """The poses of n sets of twelve lengths (n, 12), in the order of `LENGTHS`, in the assembly modes (m, 3).

    Raises ValueError where they are not twelve, or not all above zero.
    """
    lengths = np.atleast_2d(np.asarray(lengths_mm, dtype=np.float64))
    signs = np.atleast_2d(np.asarray(modes, dtype=np.float64))
    if lengths.ndim != 2 or lengths.shape[1] != 12 or not np.all(np.isfinite(lengths) & (lengths > 0.0)):
        raise ValueError(f"twelve lengths above zero make a hexapod: {', '.join(LENGTHS)}, in mm")
    if signs.ndim != 2 or signs.shape[1] != 3 or not np.all(np.abs(signs) == 1.0):
        raise ValueError("an assembly mode has three signs, +1 or -1")
    b12, b23, b31 = lengths[:, :3].T
    along = (b12**2 + b31**2 - b23**2) / (2.0 * b12)
    left = b31**2 - along**2
    base = np.zeros((len(lengths), 3, 3))
    base[:, 1, 0], base[:, 2, 0] = b12, along
    base[:, 2, 1] = np.sqrt(np.where(left > 0.0, left, np.nan))
    n, m = len(lengths), len(signs)
    first, second, third = (np.repeat(base[:, k], m, axis=0) for k in range(3))
    r11, r21, r31, r12, r22, r23, t12, t23, t31 = np.repeat(lengths[:, 3:], m, axis=0).T
    s1, s2, s3 = np.tile(signs, (n, 1)).T
    t1 = trilaterated(first, second, third, r11, r21, r31, s1)
    t2 = trilaterated(first, second, t1, r12, r22, t12, s2)
    t3 = trilaterated(t2, second, t1, t23, r23, t31, s3)
    return HexapodPoses(base, np.stack([t1, t2, t3], axis=1).reshape(n, m, 3, 3), lengths)
