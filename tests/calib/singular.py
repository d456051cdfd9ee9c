"""The distance of poses from singular ones, for tests that keep away from them."""

from __future__ import annotations

import numpy as np

from calib.arm.kinematics import nominal_jacobian
from calib.arm.robot import Robot
from calib.array import Array


def least_singular_value(robot: Robot, joints: Array, tool: Array) -> Array:
    """Return the smallest over the largest singular value of the scaled Jacobian, (n,).

    It is 0 at a singular pose.
    """
    values = np.linalg.svd(nominal_jacobian(robot, joints, tool)[1], compute_uv=False)
    return values[:, -1] / values[:, 0]
