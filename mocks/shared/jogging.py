"""A person at the pendant who jogs the arm until a ball of the tool sits in a cup.

The ball settles there to some micrometres. From a posture near it, joint angles q change by the shortest way,
with p(q) the ball on the real arm:

    dq = pinv(dp/dq) (cup - p(q))
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from mocks.shared.arm_device import ArmDevice
from mocks.shared.at_rest import Vector, state_at_rest
from mocks.shared.clock import CellClock
from mocks.world import World

SEAT_MM = 0.01  # a ball settles in a magnetic cup as well as this, per axis
JOG_STREAM = 42
_STEP_DEG = 0.01
_ENOUGH_MM = 1e-4
_STEPS = 50


def jog_into(
    world: World, arm: ArmDevice, clock: CellClock, target: str, cup: Vector, near_deg: Sequence[float]
) -> None:
    """Move the arm until `target` is in `cup` (3,) mm.

    Raises
    ------
    ValueError
        The arm does not reach the cup.
    """
    rng = np.random.default_rng([world.seed, JOG_STREAM, len(arm.sent_to), round(1e3 * float(cup[0]))])
    seat = cup + SEAT_MM * rng.normal(size=3)

    def ball(joints_deg: Vector) -> Vector:
        arm.put([float(q) for q in joints_deg])
        return np.array(world.true_point(state_at_rest(world, arm, clock), target))

    joints = np.array(near_deg, dtype=float)
    for _ in range(_STEPS):
        left = seat - ball(joints)
        if float(np.linalg.norm(left)) < _ENOUGH_MM:
            return
        turned = np.array([ball(joints + step) for step in _STEP_DEG * np.eye(len(joints))])
        slope = (turned - (seat - left)).T / _STEP_DEG
        joints = joints + np.linalg.pinv(slope) @ left
    raise ValueError(f"the arm does not bring {target} into that cup from {list(near_deg)}")
