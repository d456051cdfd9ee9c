"""Axes of a nominal arm at its zero pose, from which its structure is found.

They do not depend on the convention of its parameters.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import BasePoses, Chain, nominal_values, propagate
from calib.arm.robot import Robot
from calib.array import Array
from calib.errors import DataError

SQUARE = 1e-9  # cosine or sine that counts as none
MEETING_MM = 1e-7


@dataclass(frozen=True)
class ZeroPose:
    """The N joint axes of an arm in the base frame, at model joints zero.

    Attributes
    ----------
    turns : tuple of bool
        Whether each joint turns.
    axes, points : array of shape (N, 3)
        Directions of the axes, and points on them, mm.
    flange : array of shape (4, 4)
        Flange pose, mm.
    """

    name: str
    turns: tuple[bool, ...]
    axes: Array
    points: Array
    flange: Array

    @classmethod
    def of(cls, robot: Robot) -> ZeroPose:
        """Compute the axes of a robot at model joints zero."""
        frames = propagate(Chain.of(robot), nominal_values(robot, np.zeros((1, robot.joints))), BasePoses())
        flange = np.eye(4)
        flange[:3, :3], flange[:3, 3] = frames.rotation[0], np.broadcast_to(frames.p, (3, 1))[:, 0]
        slots = robot.joint_slots
        return cls(
            robot.name,
            tuple(frames.turns[slot] for slot in slots),
            np.stack([_column(frames.axis, slot) for slot in slots]),
            np.stack([_column(frames.origin, slot) for slot in slots]),
            flange,
        )

    @property
    def joints(self) -> int:
        """Number of joints N."""
        return len(self.turns)

    def without_first(self) -> ZeroPose:
        """Return the arm without its first axis, which is at zero."""
        return ZeroPose(self.name, self.turns[1:], self.axes[1:], self.points[1:], self.flange)

    def moved(self, joint: int, amount: Array) -> Array:
        """Return the motion of the base frame by one joint alone, shape (n, 4, 4).

        `joint` counts from 0; `amount` (n,) is in rad or mm.
        """
        out = np.zeros((len(amount), 4, 4))
        out[:, 3, 3] = 1.0
        axis = self.axes[joint]
        if not self.turns[joint]:
            out[:, :3, :3] = np.eye(3)
            out[:, :3, 3] = amount[:, None] * axis
            return out
        out[:, :3, :3] = turns_about(axis, amount)
        out[:, :3, 3] = self.points[joint] - out[:, :3, :3] @ self.points[joint]
        return out

    def reached(self, joints: Array) -> tuple[Array, Array]:
        """Compute flange poses and the Jacobian at model joints (n, N).

        The poses are (n, 4, 4), mm. The Jacobian is (n, 6, N), in mm and rad per unit of a joint.
        Source: Murray, Li, Sastry 1994, 3.2 and 3.4 (products of exponentials).
        """
        n = len(joints)
        here = np.broadcast_to(np.eye(4), (n, 4, 4))
        axes, points = np.zeros((n, self.joints, 3)), np.zeros((n, self.joints, 3))
        for k in range(self.joints):
            axes[:, k] = here[:, :3, :3] @ self.axes[k]
            points[:, k] = here[:, :3, :3] @ self.points[k] + here[:, :3, 3]
            here = here @ self.moved(k, joints[:, k])
        poses = here @ self.flange
        turns = np.array(self.turns)[:, None]
        linear = np.where(turns, np.cross(axes, poses[:, None, :3, 3] - points), axes)
        return poses, np.concatenate([linear, np.where(turns, axes, 0.0)], axis=2).transpose(0, 2, 1)

    def refused(self, why: str) -> DataError:
        """Build the error for an arm that none of the structures fits."""
        return DataError(
            f"the robot '{self.name}' has no inverse kinematics in closed form here: {why}.",
            do="Arms with a wrist, with three parallel axes (UR, palletizers) or with parallel axes alone (SCARA) have "
            "one, also on a track, and seven axes with shoulder and wrist in a point; for others give joint targets.",
            key="robot",
        )


def turns_about(axis: Array, angle: Array) -> Array:
    """Return the rotations (..., 3, 3) by angles (...) about one axis (3,).

    Source: Rodrigues' formula.
    """
    x, y, z = axis
    across = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    s, c = np.sin(angle)[..., None, None], np.cos(angle)[..., None, None]
    return np.eye(3) + s * across + (1.0 - c) * (across @ across)


def parallel(one: Array, other: Array) -> bool:
    """Test whether two directions are the same or opposite."""
    return float(np.linalg.norm(np.cross(one, other))) <= SQUARE


def square(one: Array, other: Array) -> bool:
    """Test whether two directions are square to each other."""
    return abs(float(one @ other)) <= SQUARE


def meeting(p: Array, u: Array, q: Array, v: Array) -> tuple[Array, float]:
    """Find the point of a line that is closest to a second line square to it, and the gap.

    `p` and `u` are a point and the unit direction of the first line, `q` and `v` those of the second.
    The gap is in mm.
    """
    at = p + ((q - p) @ u) * u
    off = q - at
    return at, float(np.linalg.norm(off - (off @ v) * v))


def _column(by_slot: Mapping[str, Array], slot: str) -> Array:
    return np.broadcast_to(by_slot[slot], (3, 1))[:, 0]
