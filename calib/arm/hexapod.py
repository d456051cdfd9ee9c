"""The ballbar as a 6D instrument: pose of a tool from six lengths and two triangles.

Three balls B are on the base and three balls T on the tool. Six legs join them in the design 112212331
(B1 to T1 and T2, B2 to T1, T2 and T3, B3 to T1). The tool balls follow one by one, each from three
distances (trilateration):

    t1 = Tri(B1, B2, B3; r, r, r, +)
    t2 = Tri(B1, B2, t1; r, r, |T1T2|, s2)
    t3 = Tri(t2, B2, t1; |T2T3|, r, |T3T1|, s3)

36 designs (6 labellings of the base balls x 6 of the tool balls) with 4 signs each make 144 poses, if
all legs have one length r. Lengths are in mm.

Direct kinematics: in the frame of the base, B1 = 0, B2 lies on x and B3 in the plane of x and y (y > 0).
Each tool ball lies on either side of its triangle, which gives 2 x 2 x 2 assembly modes. Twelve lengths
L fix twelve coordinates x (three of the base, nine of the tool), by |p - q|^2 = L^2 for the two balls of
each length. So

    A dx = diag(L) dL,   dx/dL = A^-1 diag(L),   U_x = (dx/dL) U_L (dx/dL)'

is the law of propagation of the GUM with every length in it, including those of the base and of the
tool. The thesis's Table 3.1 takes t1 and t2 as independent and B2 as exact, and therefore prints other
values for t3 (3.179 instead of 3.359).

Sources: Nubiola, thesis, sections 3.2 and 4.2. Manolakis 1996 (trilateration). JCGM 100 (GUM), 5.2.2.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import ArrayLike, NDArray

from calib.array import Array

LEGS = ((0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (2, 0))
"""Base ball and tool ball of every leg, in the labelling of a design."""

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
class Stances:
    """Poses that a tool can take on its six legs.

    Attributes
    ----------
    flange : array of shape (n, 4, 4)
        Pose of the flange in the frame of the base balls, mm.
    base, tool : array of int, shape (n, 6)
        Base ball and tool ball that each leg joins.
    outward : array of bool, shape (n,)
        Whether all legs leave the plane of the tool balls on the side away from the flange.
    """

    flange: Array
    base: NDArray[np.int64]
    tool: NDArray[np.int64]
    outward: NDArray[np.bool_]


def stances(base_mm: Array, tool_mm: Array, leg_mm: float) -> Stances:
    """Find the stances of a tool on six legs of one length, at most 144.

    Stances that the legs do not reach are left out.

    Parameters
    ----------
    base_mm : array of shape (3, 3)
        Balls on the base, one per row, in any frame whose z points up.
    tool_mm : array of shape (3, 3)
        Balls on the tool, one per row, in the flange frame.
    leg_mm : float
        Length of every leg.

    Raises
    ------
    ValueError
        Three balls lie in a line, the base balls lie in a vertical plane, or the plane of the tool balls
        contains the flange.
    """
    for balls in (base_mm, tool_mm):
        if np.linalg.norm(np.cross(balls[1] - balls[0], balls[2] - balls[0])) < 1.0:
            raise ValueError("three balls that lie in a line do not determine how the tool is turned")
    if abs(_normal(base_mm)[2]) < 1e-6:
        raise ValueError("the base balls lie in a vertical plane: no side of it is above")
    if abs(_normal(tool_mm) @ tool_mm.mean(axis=0)) < 1e-6:
        raise ValueError(
            "the tool balls lie in a plane with the flange: no side of it is away from the flange"
        )
    designs = list(product(permutations(range(3)), permutations(range(3)), (1.0, -1.0), (1.0, -1.0)))
    b = np.array([each[0] for each in designs])
    t = np.array([each[1] for each in designs])
    s2, s3 = np.array([each[2:] for each in designs]).T
    first, second, third = (base_mm[b[:, i]] for i in range(3))
    side = {
        (i, j): np.linalg.norm(tool_mm[t[:, i]] - tool_mm[t[:, j]], axis=1)
        for i, j in ((0, 1), (1, 2), (2, 0))
    }
    leg = np.full(len(designs), leg_mm)
    up = np.sign(np.cross(second - first, third - first)[:, 2])  # the first ball lies above the base
    t1 = trilaterated(first, second, third, leg, leg, leg, up)
    t2 = trilaterated(first, second, t1, leg, leg, side[0, 1], s2)
    t3 = trilaterated(t2, second, t1, side[1, 2], leg, side[2, 0], s3)
    there = np.stack([t1, t2, t3], axis=1)
    reached = np.all(np.isfinite(there), axis=(1, 2))
    there, b, t = there[reached], b[reached], t[reached]
    flange = np.tile(np.eye(4), (len(there), 1, 1))
    flange[:, :3, :3] = _frames(there) @ _frames(tool_mm[t]).swapaxes(1, 2)
    flange[:, :3, 3] = there[:, 0] - np.einsum("nij,nj->ni", flange[:, :3, :3], tool_mm[t[:, 0]])
    legs = np.array(LEGS)
    base, tool = b[:, legs[:, 0]], t[:, legs[:, 1]]
    normal = _normal(tool_mm)
    normal = normal * np.sign(normal @ tool_mm.mean(axis=0))  # away from the flange
    along = np.einsum("nlc,nc->nl", base_mm[base] - flange[:, None, :3, 3], flange[:, :3, :3] @ normal)
    return Stances(flange, base, tool, np.all(along > (tool_mm @ normal)[tool], axis=1))


def stances_among(base_mm: Array, tool_mm: Array, leg_mm: float) -> Stances:
    """Find the stances on every three of n >= 3 base balls (n, 3), as `stances` does.

    A fourth ball gives four times as many. `base` of the result states which of the n balls each leg joins.

    Raises
    ------
    ValueError
        There are fewer than three base balls, or as `stances`.
    """
    found = []
    for three in map(list, combinations(range(len(base_mm)), 3)):
        some = stances(base_mm[three], tool_mm, leg_mm)
        found.append(replace(some, base=np.array(three)[some.base]))
    if not found:
        raise ValueError("fewer than three balls do not determine where the tool is")
    return Stances(
        *(np.concatenate([getattr(some, part.name) for some in found]) for part in fields(Stances))
    )


def trilaterated(v1: Array, v2: Array, v3: Array, l1: Array, l2: Array, l3: Array, sign: Array) -> Array:
    """Find the points at given distances from three points; NaN if there is none.

    Parameters
    ----------
    v1, v2, v3 : array of shape (n, 3)
        Known points.
    l1, l2, l3 : array of shape (n,)
        Distances from them.
    sign : array of shape (n,)
        +1 for the point on the side of (v2 - v1) x (v3 - v1), -1 for the other.

    Returns
    -------
    array of shape (n, 3)
    """
    b = np.linalg.norm(v2 - v1, axis=1)
    e1 = (v2 - v1) / b[:, None]
    i = np.sum(e1 * (v3 - v1), axis=1)
    w = v3 - v1 - i[:, None] * e1
    j = np.linalg.norm(w, axis=1)
    e2 = w / j[:, None]
    x = (l1**2 - l2**2 + b**2) / (2.0 * b)
    y = (l1**2 - l3**2 + i**2 + j**2) / (2.0 * j) - i / j * x
    squared = l1**2 - x**2 - y**2
    z = sign * np.sqrt(np.where(squared >= 0.0, squared, np.nan))
    return v1 + x[:, None] * e1 + y[:, None] * e2 + z[:, None] * np.cross(e1, e2)


def _normal(balls_mm: Array) -> Array:
    """Return the unit vector across the plane of three balls (3, 3), shape (3,)."""
    across = np.cross(balls_mm[1] - balls_mm[0], balls_mm[2] - balls_mm[0])
    return across / np.linalg.norm(across)


def _frames(triangles: Array) -> Array:
    """Return the rotations of the frames of triangles, shape (n, 3, 3).

    A triangle has one corner per row. Its x axis points to the second corner, its z axis is normal to
    the plane.
    """
    x = triangles[:, 1] - triangles[:, 0]
    z = np.cross(x, triangles[:, 2] - triangles[:, 0])
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


@dataclass(frozen=True)
class HexapodPoses:
    """Poses for n sets of lengths in m assembly modes.

    Elements are NaN if the legs of a set do not meet, or if a triangle does not close.

    Attributes
    ----------
    base : array of shape (n, 3, 3)
        Base balls, one per row, in the frame of the base, mm.
    tool : array of shape (n, m, 3, 3)
        Tool balls, one per row, in the frame of the base, mm.
    lengths : array of shape (n, 12)
        Lengths in the order of `LENGTHS`, mm.
    """

    base: Array
    tool: Array
    lengths: Array

    @property
    def frames(self) -> Array:
        """Frames of the tool triangle, shape (n, m, 4, 4), mm.

        The origin is T1, x points to T2, and z is normal to the plane of the three balls.
        """
        second, third = (self.tool[..., k, :] - self.tool[..., 0, :] for k in (1, 2))
        x = second / np.linalg.norm(second, axis=-1)[..., None]
        rest = third - np.sum(x * third, axis=-1)[..., None] * x
        y = rest / np.linalg.norm(rest, axis=-1)[..., None]
        frames = np.zeros((*self.tool.shape[:2], 4, 4))
        frames[..., :3, :3] = np.stack([x, y, np.cross(x, y)], axis=-1)
        frames[..., :3, 3], frames[..., 3, 3] = self.tool[..., 0, :], 1.0
        return frames

    def ball_covariance(self, u_mm: ArrayLike) -> Array:
        """Compute the covariance of T1, T2 and T3, shape (n, m, 9, 9), mm2.

        `u_mm` is the standard uncertainty of the lengths, of shape (n, 12) or (12,), or one value for all.
        """
        return self._propagated(self._derivative(), u_mm)

    def _derivative(self) -> Array:
        """Differentiate the tool balls' coordinates by the lengths, shape (n, m, 9, 12).

        Elements are NaN if there is no pose.
        """
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
    """Solve the poses for n sets of twelve lengths.

    Parameters
    ----------
    lengths_mm : array of shape (n, 12)
        Lengths in the order of `LENGTHS`.
    modes : array of shape (m, 3), optional
        Assembly modes. Default: all eight.

    Raises
    ------
    ValueError
        There are not twelve lengths, a length is not above zero, or a mode does not have three signs.
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
