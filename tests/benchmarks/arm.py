"""Second arm for hundreds of simulated campaigns, as 4x4 matrices over all poses at once.

It shares no line with the chain under test; `tests/calib/chain.py`, slower and simpler still, checks it. Slots have
the same names as there. Angles rad, lengths mm, torques N.mm.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import Robot

Array = NDArray[np.float64]
Slots = Mapping[str, Array | float]


def turn(axis: str, angle: Array | float) -> Array:
    """Rotation about x, y or z: (n, 4, 4), or (4, 4) for one angle."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out = np.broadcast_to(np.eye(4), (*np.shape(angle), 4, 4)).copy()
    out[..., i, i], out[..., j, j], out[..., i, j], out[..., j, i] = c, c, -s, s
    return out


def shift(x: float, y: float, z: float) -> Array:
    """Translation, (4, 4)."""
    out = np.eye(4)
    out[:3, 3] = x, y, z
    return out


def link_frames(robot: Robot, joints: Array, add: Slots) -> list[Array]:
    """Compute the world frames of base and links 1..N at model angles (n, N).

    Each is (4, 4) or (n, 4, 4).
    """

    def of(name: str) -> float:
        return float(add.get(name, 0.0))

    thesis = robot.base == "thesis"
    d1 = robot.d[0] + of("d1") if thesis else 0.0
    frame = shift(of("base.x"), of("base.y"), of("base.z") + d1)
    for axis in "xyz":
        frame = frame @ turn(axis, of(f"base.r{axis}"))
    out = [frame]
    for k in range(robot.joints):
        name = k + 1
        alpha = turn("x", robot.alpha[k] + of(f"alpha{name}")) @ turn("y", of(f"beta{name}"))
        a = shift(robot.a[k] + of(f"a{name}"), 0.0, 0.0)
        theta = turn("z", joints[:, k] + robot.theta[k] + add.get(f"theta{name}", 0.0))
        d = shift(0.0, 0.0, 0.0 if thesis and k == 0 else robot.d[k] + of(f"d{name}"))
        parts = (alpha, a, theta, d) if robot.convention == "mdh" else (theta, d, a, alpha)
        for part in parts:
            frame = frame @ part
        out.append(frame)
    return out


def tool_frames(robot: Robot, joints: Array, add: Slots, targets: Array) -> Array:
    """Compute the world frames (n, 4, 4) of targets (n, 3) that are given in the flange frame."""
    flange = link_frames(robot, joints, add)[-1].copy()
    flange[:, :3, 3] += np.einsum("nij,nj->ni", flange[:, :3, :3], targets)
    return flange


def torques(robot: Robot, joints: Array) -> Array:
    """Compute the gravity torque about every joint of the nominal robot, (n, N).

    It is the sum of the loads beyond the joint, each with its lever.
    """
    frames = link_frames(robot, joints, {})
    out = np.zeros(joints.shape)
    for load in robot.loads:
        centre = frames[load.link] @ np.array([*load.cog_mm, 1.0])
        for k in range(load.link):
            axis = np.broadcast_to(
                frames[k + 1] if robot.convention == "mdh" else frames[k], (len(joints), 4, 4)
            )
            lever = (centre - axis[:, :, 3])[:, :3]
            moment = np.cross(lever, [0.0, 0.0, -9.81 * load.mass_kg])
            out[:, k] += np.sum(axis[:, :3, 2] * moment, axis=1)
    return out
