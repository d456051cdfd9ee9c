"""Orientation error: the angle of the rotation from the predicted to the measured orientation (its log map)."""

from __future__ import annotations

from scipy.spatial.transform import Rotation

from calib.array import Array


def rotation_vectors(predicted: Array, measured: Array) -> Array:
    """(n, 3) rotation vectors, rad, world axes, from predicted (n, 3, 3) to measured quaternions (n, 4), scalar first.

    The angle is that of the shorter way: q and -q are the same orientation.
    """
    turn = Rotation.from_quat(measured, scalar_first=True) * Rotation.from_matrix(predicted).inv()
    return turn.as_rotvec()
