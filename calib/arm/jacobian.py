"""The scaled Jacobian of the nominal tool point, and small differences of poses."""

from __future__ import annotations

import numpy as np

from calib.arm.kinematics import Chain, Placement, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array

LEVER_MM = 300.0
"""Length that turns an error of orientation into one of position, and a turn of a joint into a slide: about a link."""


def pose_difference(wanted: Array, reached: Array) -> Array:
    """(n, 6) from poses `reached` to `wanted` (n, 4, 4): shift in mm, turn as rotation vector in rad, world axes.

    The turn is exact to second order and zero only where the orientations agree: enough for small differences.
    """
    turn = wanted[:, :3, :3] @ reached[:, :3, :3].transpose(0, 2, 1)
    vector = 0.5 * np.stack(
        [turn[:, 2, 1] - turn[:, 1, 2], turn[:, 0, 2] - turn[:, 2, 0], turn[:, 1, 0] - turn[:, 0, 1]], axis=1
    )
    return np.hstack([wanted[:, :3, 3] - reached[:, :3, 3], vector])


def nominal_jacobian(robot: Robot, joints: Array, tool: Array) -> tuple[Array, Array]:
    """Poses (n, 4, 4) of the tool point and its scaled Jacobian (n, 6, N) at model joints (n, N), rad or mm.

    tool: (3,) mm in the flange frame. Rows in mm a rad or mm; those of rotation are multiplied by `LEVER_MM`.
    """
    n = len(joints)
    values = nominal_values(robot, joints) | {
        f"target.{axis}": float(x) for axis, x in zip("xyz", tool, strict=True)
    }
    frames = propagate(Chain.of(robot), values, Placement())
    poses = np.zeros((n, 4, 4))
    poses[:, :3, :3] = frames.rotation
    poses[:, :3, 3] = np.broadcast_to(frames.p, (3, n)).T
    poses[:, 3, 3] = 1.0
    jacobian = np.zeros((n, 6, robot.joints))
    for k, slot in enumerate(robot.joint_slots):
        linear, angular = frames.twist(slot)
        jacobian[:, :3, k] = np.broadcast_to(linear, (3, n)).T
        jacobian[:, 3:, k] = LEVER_MM * np.broadcast_to(angular, (3, n)).T
    return poses, jacobian


def joint_scale(robot: Robot) -> Array:
    """(N,) what a joint moves that moves as far as another turns by 1 rad: 1, or `LEVER_MM` for one that slides."""
    return np.where([kind == "slides" for kind in robot.kinds], LEVER_MM, 1.0)
