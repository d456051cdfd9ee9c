"""The declared noise of an instrument and of the robot, as the covariance of every reading.

A tracker's range is better than its angles: sigma along the beam and across it grow as fixed + ppm x distance.
The robot's repeatability enters through the joint Jacobian. Source: Nubiola, thesis 2.2.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from calib.arm.joint_kinds import JointKind
from calib.array import Array

Kind = Literal["tracker", "isotropic", "per-row"]


@dataclass(frozen=True)
class Noise:
    """Declared noise with one sigma per axis; lengths in mm, rotations in rad.

    `repeatability` is that of the robot's joints that turn, rad, and `repeatability_mm` that of joints
    that slide.
    """

    kind: Kind
    sigma_mm: float = 0.0
    station_mm: tuple[float, float, float] = (0.0, 0.0, 0.0)
    range_mm: float = 0.0
    range_ppm: float = 0.0
    transverse_mm: float = 0.0
    transverse_ppm: float = 0.0
    repeatability: float = 0.0
    rotation: float = 0.0
    length_mm: float = 0.0
    repeatability_mm: float = 0.0

    def of_each_joint(self, kinds: Sequence[JointKind]) -> Array:
        """Return the repeatability of joints of these kinds, shape (N,), rad or mm."""
        return np.array([self.repeatability_mm if kind == "slides" else self.repeatability for kind in kinds])

    def of_points(self, points: Array, per_row: Array) -> Array:
        """Compute the covariance of measured points (n, 3), shape (n, 3, 3), mm2.

        Finite rows of `per_row` (n, 3) override the declared noise.
        """
        if self.kind == "tracker":
            beam = points - np.array(self.station_mm)
            distance = np.linalg.norm(beam, axis=1)
            beam = beam / np.maximum(distance, 1e-9)[:, None]
            along = self.range_mm + self.range_ppm * 1e-6 * distance
            across = self.transverse_mm + self.transverse_ppm * 1e-6 * distance
            outer = beam[:, :, None] * beam[:, None, :]
            covariance = across[:, None, None] ** 2 * (np.eye(3) - outer) + along[:, None, None] ** 2 * outer
        else:
            covariance = np.broadcast_to(np.eye(3) * self.sigma_mm**2, (len(points), 3, 3)).copy()
        given = np.all(np.isfinite(per_row), axis=1)
        covariance[given] = per_row[given][:, :, None] ** 2 * np.eye(3)
        return covariance

    def of_joints(self, columns: Array, kinds: Sequence[JointKind]) -> Array:
        """Compute the covariance from the repeatability of the joints, shape (n, k, k).

        `columns` (N, k, n) has one row per joint.
        """
        if "slides" not in kinds:
            return self.repeatability**2 * np.einsum("jkn,jln->nkl", columns, columns)
        scattered = self.of_each_joint(kinds)[:, None, None] * columns
        return np.einsum("jkn,jln->nkl", scattered, scattered)


def whitener(covariance: Array, measured: NDArray[np.bool_]) -> Array:
    """Compute whiteners of covariances, lower triangular, shape (k, k, n).

    W C W' = I over the measured rows; the other rows of W are zero.

    Parameters
    ----------
    covariance : array of shape (n, k, k)
        Covariances C.
    measured : array of bool, shape (n, k)
        Measured rows.

    Raises
    ------
    LinAlgError
        A covariance is singular.
    """
    if measured.all():
        lower = np.linalg.cholesky(covariance)
        return np.ascontiguousarray(np.linalg.inv(lower).transpose(1, 2, 0), dtype=np.float64)
    both = measured[:, :, None] & measured[:, None, :]
    lower = np.linalg.cholesky(np.where(both, covariance, np.eye(measured.shape[1])))
    inverse = np.where(both, np.linalg.inv(lower), 0.0)
    return np.ascontiguousarray(inverse.transpose(1, 2, 0), dtype=np.float64)
