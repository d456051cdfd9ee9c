"""Conversion of sides of approach from controller joints to model joints.

The sides that a person states are the controller's; the kinematics and the effects take the model's.
"""

from __future__ import annotations

import itertools

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array


def model_sides(robot: Robot, sides: Array, coupling: str) -> Array:
    """Convert sides of approach from controller to model joints, shape (N,), +1 or -1.

    Raises
    ------
    KeyError
        The robot has no joint matrix `coupling`.
    ValueError
        A model joint that several controller joints turn would not move, so that its side is not determined.
    """
    if coupling == "none":
        return sides
    moved = np.array(robot.joint_matrices[coupling].matrix) @ sides
    still = np.flatnonzero(moved == 0.0)
    if len(still):
        raise ValueError(
            f"joint {still[0] + 1} of the model does not move when the controller's joints arrive from these sides"
        )
    return np.sign(moved)


def sides_that_move(robot: Robot, coupling: str) -> tuple[int, ...]:
    """Choose sides of the controller's joints under which every joint of the model moves, (N,).

    As few as possible are from above.

    Raises
    ------
    KeyError
        The robot has no joint matrix `coupling`.
    ValueError
        There are no such sides.
    """
    given = sorted(itertools.product((1, -1), repeat=robot.joints), key=lambda sides: sides.count(-1))
    moved = np.array(given) @ (
        np.eye(robot.joints) if coupling == "none" else np.array(robot.joint_matrices[coupling].matrix).T
    )
    moving = np.flatnonzero(np.all(moved != 0.0, axis=1))
    if not len(moving):
        raise ValueError(f"there are no sides under which every joint moves by '{coupling}'")
    return given[moving[0]]
