"""Arm that every package identifies, and its measured points; numpy, no project code.

ABB IRB 120 in modified DH (Craig), `Rx(alpha) Ry(beta) Tx(a) Rz(theta + q) Tz(d)`, on a base `T(x, y, z) Rx Ry Rz`,
with one target on the flange, off axis 6. rad, mm. Source of the nominal numbers: Nubiola, thesis, Annex I.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

SIGMA_MM = 0.03
TARGET_MM = (60.0, 40.0, 80.0)
LOWER = np.radians([-165.0, -110.0, -110.0, -160.0, -120.0, -180.0])
UPPER = np.radians([165.0, 110.0, 70.0, 160.0, 120.0, 180.0])
BETA_3 = np.radians(0.13)


def numbers(*values: float) -> Array:
    """Return a new array, so that no two arms share one."""
    return np.array(values)


@dataclass
class Arm:
    """The numbers of one arm; those of the maker by default."""

    alpha: Array = field(default_factory=lambda: np.radians([0.0, -90.0, 0.0, -90.0, 90.0, -90.0]))
    a: Array = field(default_factory=lambda: numbers(0.0, 0.0, 270.0, 70.0, 0.0, 0.0))
    theta: Array = field(default_factory=lambda: np.radians([0.0, -90.0, 0.0, 0.0, 0.0, 180.0]))
    d: Array = field(default_factory=lambda: numbers(290.0, 0.0, 0.0, 302.0, 0.0, 72.0))
    beta: Array = field(default_factory=lambda: np.zeros(6))
    base_mm: Array = field(default_factory=lambda: np.zeros(3))
    base_rad: Array = field(default_factory=lambda: np.zeros(3))
    target_mm: Array = field(default_factory=lambda: numbers(*TARGET_MM))


def true_arm(seed: int, *, twisted: bool) -> Arm:
    """Draw an arm as built, with usual deviations of every DH number, its base and its target.

    If `twisted`, axes 2 and 3, which are meant to be parallel, also deviate by 0.13 deg about y (Hayati's beta).
    """
    rng = np.random.default_rng(seed)
    arm = Arm()
    arm.alpha = arm.alpha + rng.normal(0.0, np.radians(0.1), 6)
    arm.theta = arm.theta + rng.normal(0.0, np.radians(0.2), 6)
    arm.a = arm.a + rng.normal(0.0, 0.3, 6)
    arm.d = arm.d + rng.normal(0.0, 0.3, 6)
    arm.base_mm = rng.normal(0.0, 1.0, 3)
    arm.base_rad = rng.normal(0.0, np.radians(0.1), 3)
    arm.target_mm = arm.target_mm + rng.normal(0.0, 0.5, 3)
    arm.beta[2] = BETA_3 if twisted else 0.0
    return arm


def turn(axis: int, angle: Array | float) -> Array:
    """Return a rotation about x, y or z, (..., 4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    out = np.zeros((*np.shape(angle), 4, 4))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    out[..., axis, axis] = out[..., 3, 3] = 1.0
    out[..., i, i] = out[..., j, j] = c
    out[..., i, j], out[..., j, i] = -s, s
    return out


def shift(x: float, y: float, z: float) -> Array:
    """Return a translation, (4, 4)."""
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def points(arm: Arm, joints: Array) -> Array:
    """Compute the target positions at joint angles (n, 6), (n, 3), mm."""
    pose = (
        shift(*arm.base_mm) @ turn(0, arm.base_rad[0]) @ turn(1, arm.base_rad[1]) @ turn(2, arm.base_rad[2])
    )
    for k in range(6):
        pose = pose @ turn(0, arm.alpha[k]) @ turn(1, arm.beta[k]) @ shift(arm.a[k], 0.0, 0.0)
        pose = pose @ turn(2, arm.theta[k] + joints[:, k]) @ shift(0.0, 0.0, arm.d[k])
    return pose[..., :3, :3] @ arm.target_mm + pose[..., :3, 3]


@dataclass(frozen=True)
class Readings:
    """Joint angles (n, 6) and measured points (n, 3) to identify from.

    The fresh ones, without noise, serve to judge the result.
    """

    joints: Array
    measured: Array
    fresh_joints: Array
    fresh_points: Array

    def rms(self, predicted: Array) -> float:
        """Return the RMS distance of `predicted` (500, 3) from the true fresh points, mm."""
        return float(np.sqrt(np.mean(np.sum((predicted - self.fresh_points) ** 2, axis=1))))


def measure(arm: Arm, count: int, seed: int, *, fresh: int = 500) -> Readings:
    """Measure `count` points with isotropic noise, and `fresh` points without noise.

    The joint angles are drawn within the limits.
    """
    rng = np.random.default_rng(seed)
    joints, fresh_joints = rng.uniform(LOWER, UPPER, (count, 6)), rng.uniform(LOWER, UPPER, (fresh, 6))
    noise = rng.normal(0.0, SIGMA_MM, (count, 3))
    return Readings(joints, points(arm, joints) + noise, fresh_joints, points(arm, fresh_joints))
