"""The ballbar as a 6D instrument: the poses of a tool on six legs of one length between three balls and three.

Three balls B on the base, three T on the tool, six legs in the design 112212331: B1 to T1 and T2, B2 to T1, T2 and
T3, B3 to T1. The tool balls follow one by one, each from three distances (trilateration):

    t1 = Tri(B1, B2, B3; r, r, r, +)
    t2 = Tri(B1, B2, t1; r, r, |T1T2|, s2)
    t3 = Tri(t2, B2, t1; |T2T3|, r, |T3T1|, s3)

36 designs (6 labellings of the base balls x 6 of the tool balls) with 4 signs each make 144 poses. Lengths mm.
Source: Nubiola, thesis, sections 3.2 and 4.2 (trilateration: Manolakis 1996).
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from itertools import combinations, permutations, product

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

LEGS = ((0, 0), (0, 1), (1, 0), (1, 1), (1, 2), (2, 0))
"""Base ball and tool ball of every leg, in the labelling of a design."""


@dataclass(frozen=True)
class Stances:
    """The poses that a tool can take on its six legs.

    flange: (n, 4, 4) flange in the frame of the base balls, mm; base, tool: (n, 6) which balls each leg joins;
    outward: (n,) whether all legs leave the plane of the tool balls on the side away from the flange.
    """

    flange: Array
    base: NDArray[np.int64]
    tool: NDArray[np.int64]
    outward: NDArray[np.bool_]


def stances(base_mm: Array, tool_mm: Array, leg_mm: float) -> Stances:
    """Up to 144 stances for balls (3, 3) on the base, in any frame with its z up, and (3, 3) on the flange, one a row.

    Stances that six legs of `leg_mm` do not reach are left out. Raises ValueError for balls in a line.
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
    """The stances on every three of n >= 3 base balls (n, 3): with a fourth ball four times as many. As `stances`.

    base: which of the n each leg joins. Raises ValueError.
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
    """(n, 3) points at the distances l1, l2, l3 (n,) from v1, v2, v3 (n, 3); NaN where there is none.

    sign (n,): +1 for the point on the side of (v2 - v1) x (v3 - v1), -1 for the other.
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
    """(3,) unit vector across the plane of three balls (3, 3)."""
    across = np.cross(balls_mm[1] - balls_mm[0], balls_mm[2] - balls_mm[0])
    return across / np.linalg.norm(across)


def _frames(triangles: Array) -> Array:
    """(n, 3, 3) rotations of the frames of triangles (n, 3, 3), corners one a row: x to the second, z normal."""
    x = triangles[:, 1] - triangles[:, 0]
    z = np.cross(x, triangles[:, 2] - triangles[:, 0])
    x = x / np.linalg.norm(x, axis=1, keepdims=True)
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)
