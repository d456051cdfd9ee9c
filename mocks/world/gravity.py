"""Gravity moments at the joints.

M_i = sum over loads beyond joint i of (c_j - o_i) x (m_j g),   tau_i = z_i . M_i     in N.mm,
c_j centre of a load, o_i and z_i origin and axis of joint i, g = (0, 0, -9.81) m/s2. Positive in the
direction gravity pushes (equal to -dU/dq). Nominal geometry at the commanded angles, as in Nubiola's thesis.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mocks.world.kinematics import axis_frame
from mocks.world.robots import Load
from mocks.world.transforms import Matrix, Vector

G_M_S2 = 9.81


def load_points(chain: list[Matrix], loads: Sequence[Load]) -> list[tuple[int, float, list[float]]]:
    """Return the link, the weight in N, and the centre in mm in the base frame of each load."""
    points = []
    for load in loads:
        frame = chain[load.link]
        centre = frame[:3, :3] @ np.array(load.cog_mm) + frame[:3, 3]
        points.append((load.link, load.mass_kg * G_M_S2, centre.tolist()))
    return points


def moment_about(
    origin: Sequence[float], points: list[tuple[int, float, list[float]]], first_link: int
) -> Vector:
    """Moment (3,) N.mm about `origin` (mm) of all loads on `first_link` and beyond."""
    mx = my = 0.0
    for link, weight, centre in points:
        if link >= first_link:
            # r x (0, 0, -W) = (-W r_y, W r_x, 0)
            mx -= weight * (centre[1] - origin[1])
            my += weight * (centre[0] - origin[0])
    return np.array([mx, my, 0.0])


def moments(convention: str, chain: list[Matrix], loads: Sequence[Load]) -> list[Vector]:
    """Moment vector (3,) N.mm at every joint, base frame; index 0 is joint 1."""
    points = load_points(chain, loads)
    result = []
    for joint in range(1, len(chain)):
        origin = axis_frame(convention, chain, joint)[:3, 3].tolist()
        result.append(moment_about(origin, points, joint))
    return result


def torques(convention: str, chain: list[Matrix], joint_moments: list[Vector]) -> list[float]:
    """Torque N.mm about every joint's own axis; index 0 is joint 1."""
    result = []
    for joint, moment in enumerate(joint_moments, start=1):
        z = axis_frame(convention, chain, joint)[:3, 2]
        result.append(float(z @ moment))
    return result


def overturning_moment(chain: list[Matrix], loads: Sequence[Load]) -> Vector:
    """Moment (3,) N.mm of the whole arm about the origin of the base."""
    return moment_about([0.0, 0.0, 0.0], load_points(chain, loads), 1)
