"""Random poses of a campaign: joint ranges, the table, the approach."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mocks.world.arm import ArmState
from mocks.world.draw import random_joints
from mocks.world.kinematics import frames, nominal_geometry
from mocks.world.robots import Robot
from mocks.world.transforms import place

TABLE_Z_MM = 20.0
_TRIES = 100  # some robots have no table below them
APPROACH_DEG, LONG_APPROACH_DEG = 5.0, 15.0


def above_table(robot: Robot, joints_deg: Sequence[float], targets: Mapping[str, Sequence[float]]) -> bool:
    """Return whether all targets, and the frames from the elbow on, are above the table.

    The robot is nominal.
    """
    chain = frames(robot.convention, nominal_geometry(robot), robot.internal(joints_deg))
    if any(frame[2, 3] <= TABLE_Z_MM for frame in chain[2:]):
        return False
    return all(place(chain[-1], p)[2] > TABLE_Z_MM for p in targets.values())


def random_pose(
    robot: Robot, targets: Mapping[str, Sequence[float]], rng: np.random.Generator
) -> tuple[float, ...]:
    """Draw joints in deg or mm within the robot's sensible ranges.

    All targets are above the table if such a pose is found.
    """
    joints = random_joints(robot, rng)
    for _ in range(_TRIES):
        if above_table(robot, joints, targets):
            break
        joints = random_joints(robot, rng)
    return joints


def random_sides(n_joints: int, rng: np.random.Generator) -> tuple[int, ...]:
    """Draw +1 or -1 for every joint, independent of each other and of the pose."""
    return tuple(int(s) for s in rng.choice((-1, 1), size=n_joints))


def approach_point(
    joints_deg: Sequence[float], sides: Sequence[int], length_deg: float = APPROACH_DEG
) -> tuple[float, ...]:
    """Return the start of the last move, deg: q - side x `length_deg` on every joint.

    The default length is 5 deg (thesis, section 2.5).
    """
    return tuple(round(q - s * length_deg, 3) for q, s in zip(joints_deg, sides, strict=True))


def random_state(
    robot: Robot,
    targets: Mapping[str, Sequence[float]],
    rng: np.random.Generator,
    t_s: float,
    t_air_c: float,
    reading: int,
) -> ArmState:
    """Draw a random pose approached from random sides."""
    joints = random_pose(robot, targets, rng)
    sides = random_sides(len(joints), rng)
    return ArmState(joints, approach_point(joints, sides), sides, t_s, t_air_c, reading)
