"""Between the model's joint angles and those the controller counts: model = M x controller + offset.

Joint limits and the sides that a person states are the controller's; the kinematics and the effects take the
model's.
"""

from __future__ import annotations

import numpy as np

from calib.kinematics import Array
from calib.robot import Robot


def controller_angles(robot: Robot, joints: Array, coupling: str) -> Array:
    """(..., N) model angles -> (..., N) controller angles, rad. Raises KeyError for an unknown `coupling`."""
    if coupling == "none":
        return joints
    joint_matrix = robot.joint_matrices[coupling]
    return (joints - np.array(joint_matrix.offset)) @ np.linalg.inv(np.array(joint_matrix.matrix)).T


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
