"""Inverse kinematics of the nominal robot near a pose that it is in: Newton's method on the exact chain, batched.

    J(q) dq = twist from FK(q) to the wanted pose,   q <- q + dq

damped (Levenberg), seeded at the joints in hand, so that the branch (flip, front/back, up/down) is kept. Rotations
weigh with `LEVER_MM`, which makes the columns of J comparable. Source: Wampler 1986 for the damping.
"""

from __future__ import annotations

import numpy as np

from calib.arm.kinematics import Chain, Placement, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array

LEVER_MM = 300.0
"""Length that turns an error of orientation into one of position: about an arm's link."""

ITERATIONS = 12
_DAMPING = 1e-12  # of the largest singular value squared: only keeps an exactly singular pose solvable
_REACHED = 1e-13  # rad: the step that no longer changes anything


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
    """Poses (n, 4, 4) of the tool point and its scaled Jacobian (n, 6, N) at model angles (n, N), rad.

    tool: (3,) mm in the flange frame. Rows in mm a rad; those of rotation are multiplied by `LEVER_MM`.
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
    for k in range(robot.joints):
        linear, angular = frames.twist(f"theta{k + 1}")
        jacobian[:, :3, k] = np.broadcast_to(linear, (3, n)).T
        jacobian[:, 3:, k] = LEVER_MM * np.broadcast_to(angular, (3, n)).T
    return poses, jacobian


def least_singular_value(robot: Robot, joints: Array, tool: Array) -> Array:
    """(n,) smallest over largest singular value of the scaled Jacobian: how close a pose is to a singular one."""
    values = np.linalg.svd(nominal_jacobian(robot, joints, tool)[1], compute_uv=False)
    return values[:, -1] / values[:, 0]


def branch_sign(robot: Robot, joints: Array, tool: Array) -> Array:
    """(n,) sign of the Jacobian's determinant: it stays while no singular pose is crossed. 1 unless N is 6."""
    if robot.joints != 6:
        return np.ones(len(joints))
    return np.sign(np.linalg.det(nominal_jacobian(robot, joints, tool)[1] / LEVER_MM))


def nominal_inverse(robot: Robot, poses: Array, seed: Array, tool: Array) -> Array:
    """(n, N) model angles, rad, that bring the nominal tool point to `poses` (n, 4, 4), base frame, near `seed` (n, N).

    Where a pose is out of reach the result is the nearest that Newton's method came to: the caller checks.
    """
    joints = seed.copy()
    for _ in range(ITERATIONS):
        reached, jacobian = nominal_jacobian(robot, joints, tool)
        error = pose_difference(poses, reached)
        error[:, 3:] *= LEVER_MM
        transposed = jacobian.transpose(0, 2, 1)
        normal = transposed @ jacobian
        damping = _DAMPING * np.trace(normal, axis1=1, axis2=2)
        normal += damping[:, None, None] * np.eye(robot.joints)
        step = np.linalg.solve(normal, transposed @ error[:, :, None])[:, :, 0]
        joints = joints + step
        if np.max(np.abs(step), initial=0.0) < _REACHED:
            break
    return joints
