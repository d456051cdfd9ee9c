"""Sides of approach of the model's joints, from those of the joints that the controller counts.

The sides that a person states are the controller's; the kinematics and the effects take the model's.
"""

from __future__ import annotations

import itertools

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array


def model_sides(robot: Robot, sides: Array, coupling: str) -> Array:
    """(N,) sides of approach of the model's joints, from those of the controller's, +1 or -1.

    Raises KeyError for an unknown `coupling`, ValueError where a model joint that several controller joints turn
    would not move: its side is then not determined.
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
    """(N,) sides of the controller's joints, as few from above as may be, under which every joint of the model moves.

    Raises KeyError for an unknown `coupling`, ValueError where there are none.
    """
    given = sorted(itertools.product((1, -1), repeat=robot.joints), key=lambda sides: sides.count(-1))
    moved = np.array(given) @ (
        np.eye(robot.joints) if coupling == "none" else np.array(robot.joint_matrices[coupling].matrix).T
    )
    moving = np.flatnonzero(np.all(moved != 0.0, axis=1))
    if not len(moving):
        raise ValueError(f"there are no sides under which every joint moves by '{coupling}'")
    return given[moving[0]]
