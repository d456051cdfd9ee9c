"""Inverse kinematics of the nominal robot near a pose that it is in: Newton's method on the exact chain, batched.

    J(q) dq = twist from FK(q) to the wanted pose,   q <- q + dq

seeded at the joints in hand, so that the branch (flip, front/back, up/down) is kept, and within the freedoms that the
arm has (`calib.arm.freedoms`): what it cannot move or turn is left. Rotations weigh with `LEVER_MM`, which makes
the columns of J comparable.
"""

from __future__ import annotations

import numpy as np

from calib.arm.freedoms import Freedoms
from calib.arm.jacobian import LEVER_MM, joint_scale, nominal_jacobian, pose_difference
from calib.arm.robot import Robot
from calib.array import Array

ITERATIONS = 12
_REACHED = 1e-13  # rad: the step that no longer changes anything


def nominal_inverse(
    robot: Robot, poses: Array, seed: Array, tool: Array, freedoms: Freedoms | None = None
) -> Array:
    """(n, N) model joints, rad or mm, that bring the nominal tool point to `poses` (n, 4, 4), mm, near `seed` (n, N).

    freedoms: of the arm, default all six with every joint free. Where a pose is out of reach the result is the nearest
    that Newton's method came to: the caller checks.
    """
    arm = Freedoms(np.diag(joint_scale(robot)), 6, places=True, turns=3) if freedoms is None else freedoms
    joints, scale = seed.copy(), joint_scale(robot)
    for _ in range(ITERATIONS):
        reached, jacobian = nominal_jacobian(robot, joints, tool)
        error = pose_difference(poses, reached)
        error[:, 3:] *= LEVER_MM
        step, _ = arm.step(jacobian, error)
        joints = joints + step
        if np.max(np.abs(step / scale), initial=0.0) < _REACHED:
            break
    return joints
