"""Sides of approach of the model's joints, from those of the joints that the controller counts.

The sides that a person states are the controller's; the kinematics and the effects take the model's.
"""

from __future__ import annotations

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
