"""Vectors as three arrays of components, so that every product runs over all branches and poses at once."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

Mask = NDArray[np.bool_]
Vector = tuple[Array, Array, Array]


def columns(vectors: Array) -> Vector:
    """Components of (n, 3) vectors, each (n,)."""
    x, y, z = np.ascontiguousarray(vectors.T)
    return x, y, z


def turn_back(v: Vector, angle: Array, plane: tuple[int, int]) -> Vector:
    """Components of v after a rotation by -angle that leads the first axis of the plane to the second."""
    i, j = plane
    c, s = np.cos(angle), np.sin(angle)
    out = list(np.broadcast_arrays(*v, angle)[:3])
    out[i], out[j] = c * v[i] + s * v[j], c * v[j] - s * v[i]
    return out[0], out[1], out[2]


def in_axes(rotation: Array, v: Vector) -> Vector:
    """Components of v in other axes: the rows of `rotation`."""
    x, y, z = (row[0] * v[0] + row[1] * v[1] + row[2] * v[2] for row in rotation)
    return x, y, z


def wrapped(joints: Array, turns: tuple[bool, ...]) -> Array:
    """(..., N) joints with the angles between -pi and pi."""
    return joints - 2.0 * np.pi * np.round(np.where(turns, joints, 0.0) / (2.0 * np.pi))
