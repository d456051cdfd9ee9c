"""Errors of the gears of a simulated UR5: bending, one and two waves per turn, and play.

The code is independent of `calib` and uses 4x4 matrices. Masses: the maker's published table.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

A = np.array([0.0, -425.0, -392.0, 0.0, 0.0, 0.0])
D = np.array([89.16, 0.0, 0.0, 109.2, 94.7, 82.3])
ALPHA = np.radians([90.0, 0.0, 0.0, 90.0, -90.0, 0.0])
LOADS = (  # link, kg, centre in its frame, mm
    (1, 3.7, (0.0, -25.61, 1.93)),
    (2, 8.393, (212.5, 0.0, 113.36)),
    (3, 2.33, (150.0, 0.0, 26.5)),
    (4, 1.219, (0.0, -1.8, 16.34)),
    (5, 1.219, (0.0, 1.8, 16.34)),
    (6, 0.1879, (0.0, 0.0, -1.159)),
)
TOOL_LOAD = (6, 0.5, (0.0, 0.0, 80.0))  # which no robot file knows
G_M_S2 = 9.81


@dataclass(frozen=True)
class Gears:
    """Gears of one arm.

    `compliance` (6,) is in rad/(N.mm). `waves` (2, 2, 6), rad, are cosine and sine of once and twice per turn.
    `play` (6,), rad, is the whole gap.
    """

    compliance: Array
    waves: Array
    play: Array

    def turned(self, joints: Array, side: Array) -> Array:
        """Compute the true angles of the arm (n, 6), rad, for joints (n, 6) on sides of their gaps."""
        out = joints + self.compliance * torques(joints)
        for turn in (1, 2):
            cosine, sine = self.waves[:, turn - 1]
            out = out + cosine * np.cos(turn * joints) + sine * np.sin(turn * joints)
        return out - 0.5 * self.play * side


def gears(
    rng: np.random.Generator, *, softness: float = 1.0, waves_rad: float = 0.0, play_rad: float = 0.0
) -> Gears:
    """Draw gears about the compliances of Nubiola's IRB 120 (thesis, Table 2.6).

    The simulated cell has the same compliances.
    """
    usual = np.array([0.0, 0.032e-6, 0.130e-6, 0.605e-6, 0.419e-6, 0.647e-6])
    return Gears(
        compliance=softness * usual * rng.uniform(0.7, 1.3, 6),
        waves=waves_rad * rng.normal(size=(2, 2, 6)) * np.array([1.0, 0.5])[:, None],
        play=play_rad * rng.uniform(0.0, 2.0, 6),
    )


def torques(joints: Array) -> Array:
    """Compute the gravity torque of links and tool about every joint, (n, 6), N.mm.

    The base is upright.
    """
    n = len(joints)
    frame = np.broadcast_to(np.eye(4), (n, 4, 4))
    frames = [frame]
    for k in range(6):
        c, s, ca, sa = np.cos(joints[:, k]), np.sin(joints[:, k]), np.cos(ALPHA[k]), np.sin(ALPHA[k])
        link = np.zeros((n, 4, 4))
        link[:, 0] = np.stack([c, -s * ca, s * sa, A[k] * c], axis=1)
        link[:, 1] = np.stack([s, c * ca, -c * sa, A[k] * s], axis=1)
        link[:, 2] = [0.0, sa, ca, D[k]]
        link[:, 3, 3] = 1.0
        frame = frame @ link
        frames.append(frame)
    out = np.zeros((n, 6))
    for link, mass, centre in (*LOADS, TOOL_LOAD):
        at = (frames[link] @ np.append(centre, 1.0))[:, :3]
        weight = np.array([0.0, 0.0, -mass * G_M_S2])
        for k in range(link):
            axis, origin = frames[k][:, :3, 2], frames[k][:, :3, 3]
            out[:, k] += np.sum(axis * np.cross(at - origin, weight), axis=1)
    return out
