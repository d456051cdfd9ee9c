"""The arm at rest and the limbs that hide targets, for instruments other than the tracker.

The robot's repeatability belongs to a move (`World.arrival_error`): all readings before the next move have the
same error. Adding it to the angles of the state gives the pose of the flange at rest.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import CellClock
from mocks.world import ArmState, World
from mocks.world.kinematics import frames, nominal_geometry
from mocks.world.transforms import Matrix

Vector = NDArray[np.float64]
LIMB_MM = 55.0  # half the thickness of a limb
_LIMBS = 5  # frames 0..4: the wrist is where the tool begins


def state_at_rest(world: World, arm: ArmDevice, clock: CellClock) -> ArmState:
    """Return the current state of the arm, with the robot's repeatability in its last move."""
    now = clock.now()
    error = world.robot.outside(world.arrival_error(arm.moves).tolist())
    return ArmState(
        joints_deg=tuple(q + e for q, e in zip(arm.joints_deg(), error, strict=True)),
        previous_deg=arm.previous_deg,
        sides=arm.sides,
        t_s=now,
        t_air_c=world.air_c(now),
        reading=arm.moves,
    )


def target_frame(world: World, state: ArmState, name: str) -> Matrix:
    """Frame of tool target `name` in the world, (4, 4): the flange's turn at the target's place."""
    frame = world.flange(state).copy()
    frame[:3, 3] = world.true_point(state, name)
    return frame


def limbs(world: World, arm: ArmDevice) -> list[Vector]:
    """Return the ends of the limbs of the nominal arm now, world frame, each (3,) mm."""
    robot = world.robot
    chain = frames(robot.convention, nominal_geometry(robot), robot.internal(arm.joints_deg()))
    return [np.zeros(3), *(frame[:3, 3] for frame in chain[:_LIMBS])]


def hidden_by(ends: list[Vector], eye: Vector, point: Vector, thickness_mm: float = LIMB_MM) -> bool:
    """Return whether a link of the arm is between `eye` and `point`, both (3,) mm."""
    return any(
        float(np.linalg.norm(b - a)) > 1.0 and _distance(a, b, eye, point) < thickness_mm
        for a, b in pairwise(ends)
    )


def _distance(a: Vector, b: Vector, c: Vector, d: Vector) -> float:
    """Shortest distance of two segments ab and cd (3,), by the closed form with clamping."""
    u, v, w = b - a, d - c, a - c
    uu, uv, vv, uw, vw = u @ u, u @ v, v @ v, u @ w, v @ w
    det = uu * vv - uv * uv
    s = np.clip((uv * vw - vv * uw) / det, 0.0, 1.0) if det > 1e-9 * uu * vv else 0.0
    t = np.clip((uv * s + vw) / vv, 0.0, 1.0)
    s = np.clip((uv * t - uw) / uu, 0.0, 1.0)
    return float(np.linalg.norm(w + s * u - t * v))
