"""Homogeneous 4x4 transforms, one function per elementary motion. Lengths mm, angles rad."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Vector = NDArray[np.float64]


def rx(angle: float) -> Matrix:
    """Rotation about x by `angle` rad, (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[1.0, 0.0, 0.0, 0.0], [0.0, c, -s, 0.0], [0.0, s, c, 0.0], [0.0, 0.0, 0.0, 1.0]])


def ry(angle: float) -> Matrix:
    """Rotation about y by `angle` rad, (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s, 0.0], [0.0, 1.0, 0.0, 0.0], [-s, 0.0, c, 0.0], [0.0, 0.0, 0.0, 1.0]])


def rz(angle: float) -> Matrix:
    """Rotation about z by `angle` rad, (4, 4)."""
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, -s, 0.0, 0.0], [s, c, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]])


def shift(x: float, y: float, z: float) -> Matrix:
    """Translation by (x, y, z) mm, (4, 4)."""
    return np.array([[1.0, 0.0, 0.0, x], [0.0, 1.0, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]])


def turn(rotation_vector: Sequence[float] | Vector) -> Matrix:
    """Return the rotation (4, 4) about `rotation_vector` by its length in rad (Rodrigues)."""
    x, y, z = (float(v) for v in rotation_vector)
    angle = math.sqrt(x * x + y * y + z * z)
    matrix = np.eye(4)
    if angle == 0.0:
        return matrix
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) / angle
    matrix[:3, :3] += math.sin(angle) * cross + (1.0 - math.cos(angle)) * (cross @ cross)
    return matrix


def place(matrix: Matrix, point: Sequence[float] | Vector) -> Vector:
    """Transform a `point` (3,) mm from the frame `matrix` (4, 4) to its parent frame."""
    return matrix[:3, :3] @ np.asarray(point, dtype=float) + matrix[:3, 3]
