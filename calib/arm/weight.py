"""Joints on which gravity acts, and estimated link masses if only the total mass is known."""

from __future__ import annotations

import numpy as np

from calib.arm.kinematics import statics
from calib.arm.robot import HEAVIEST_KG, Load, Robot
from calib.array import Array
from calib.errors import DataError

_PROBE = (200.0, 200.0, 200.0)  # mm off the last frame: of what lies on the last axis joint 6 feels nothing
_LEAST = 1e-3  # share of the largest torque of the probe that counts as none


def estimated_loads(robot: Robot, mass_kg: float) -> tuple[Load, ...]:
    """Estimate the loads of an arm from the mass of the whole arm, kg.

    Every millimetre of the way from the base to the flange, along the DH parameters, weighs the same;
    the centre of the parts that move with a joint follows. External axes and the stroke of slides weigh
    nothing.

    On the ten built-in arms with published masses the torques about joints 2 and 3, scaled joint by
    joint as a compliance does, differ from the published ones by 5 % RMS (1 to 13 %). A density that
    falls towards the flange is worse (10 % if linear), since the motors of the wrist are heavy.

    Raises
    ------
    DataError
        No arm has this mass, or the arm has no length.
    """
    if not 0.0 < mass_kg <= HEAVIEST_KG:
        raise DataError(
            f"a mass of {mass_kg:g} kg is not possible.", do="Give the mass of the arm in kg.", key="--mass"
        )
    external = {link for link, _ in robot.external}
    mass, moment = np.zeros(robot.joints), np.zeros((robot.joints, 3))
    for k, way in enumerate(_ways(robot)):
        if k + 1 not in external:
            length = np.linalg.norm(np.diff(way, axis=0), axis=1)
            mass[k] = length.sum()
            moment[k] = length @ (way[:-1] + way[1:]) / 2.0
    if not mass.any():
        raise DataError("has no length.", do="Give a_mm and d_mm of its links.", file=robot.name, key="link")
    loads = []
    for k in np.flatnonzero(mass_kg * mass / mass.sum() >= 0.005):
        x, y, z = (round(float(c), 1) + 0.0 for c in moment[k] / mass[k])
        loads.append(Load(int(k) + 1, round(float(mass_kg * mass[k] / mass.sum()), 2), (x, y, z)))
    return tuple(loads)


def _ways(robot: Robot) -> list[Array]:
    """Return the three corners of each link in its own frame, one array (3, 3) per link.

    They are the corners of the spans d and a that move with its joint.
    """
    if robot.convention == "mdh":  # along d of this link, then along a of the next
        ends = (*robot.a[1:], 0.0)
        return [np.array([(0, 0, -d), (0, 0, 0), (a, 0, 0)]) for d, a in zip(robot.d, ends, strict=True)]
    return [
        np.array([(-a, -d * np.sin(alpha), -d * np.cos(alpha)), (-a, 0, 0), (0, 0, 0)])
        for alpha, a, d in zip(robot.alpha, robot.a, robot.d, strict=True)
    ]


def joints_under_gravity(
    robot: Robot, joints: Array, gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
) -> tuple[int, ...]:
    """Find the joints on which gravity acts with a varying torque.

    `joints` (n, N) are model joints. The result holds for any masses of the links. Joint 1 of an upright
    arm is not among them, nor is any joint that turns in a SCARA.
    """
    probe = statics(robot, joints, (Load(robot.joints, 1.0, _PROBE),), gravity).torque
    varies = np.ptp(probe, axis=0)
    return tuple(int(k) + 1 for k in np.flatnonzero(varies > _LEAST * max(varies.max(), 1.0)))
