"""Inverse kinematics of a robot: find its structure and solve all branches of poses.

`InvertibleArm` is the interface of arms with a known structure; they solve all branches of a batch of
poses at once.

If an arm is on a track, a column or a turntable, the external axis stays where the seed has it. The pose
is transformed back by the motion of that axis, and the arm is solved.

A SCARA has three axes that turn and one that slides, all parallel, in any order (RRPR, RRRP, PRRR).
Motions along and about parallel axes can be exchanged, so only the order of the three that turn counts.
Let u be the common direction, and a, b, c the points of the axes across it.

    turn    theta_a + theta_b + theta_c = angle of R about u (each by its sense)
    elbow   |c' - a|^2 = |ab|^2 + |bc|^2 + 2 |ab| |bc| cos(theta_b + phi)   gives theta_b, right and left, then theta_a
    slide   what the flange is raised along u

Source: Craig, Introduction to Robotics, 4.4 (two links in a plane).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from calib.arm.inverse_kinematics.five_axes import FiveAxes
from calib.arm.inverse_kinematics.offset_wrist import OffsetWrist
from calib.arm.inverse_kinematics.seven_axes import SevenAxes
from calib.arm.inverse_kinematics.six_axes import SixAxes
from calib.arm.inverse_kinematics.solutions import BranchResult, Solutions
from calib.arm.inverse_kinematics.turns import bent
from calib.arm.inverse_kinematics.zero_pose import MEETING_MM, ZeroPose, parallel, turns_about
from calib.arm.robot import Robot
from calib.array import Array
from calib.errors import DataError

LEVEL = 1e-4
"""rad: a tilt that a pose may ask for by its rounding; the arm leaves it out."""

_RIGHT = np.array([1.0, -1.0]).reshape(2, 1)


@dataclass(frozen=True)
class Scara:
    """Zero pose of a SCARA.

    Attributes
    ----------
    plane : array of shape (3, 3)
        Rows x, y, u.
    turning : tuple of int
        Joints a, b, c, counted from 0.
    sliding : int
        The joint that slides, counted from 0.
    senses : array of shape (4,)
        +1 or -1 for each joint that points along u or against it.
    upper, fore : tuple of float
        Angle, rad, and length, mm, of the links from a to b and from b to c.
    """

    zero: ZeroPose
    plane: Array
    turning: tuple[int, int, int]
    sliding: int
    senses: Array
    upper: tuple[float, float]
    fore: tuple[float, float]

    kind = "in closed form, SCARA"
    branches = ("right", "left")

    @classmethod
    def of(cls, zero: ZeroPose) -> Scara:
        """Find the structure of an arm from its zero pose.

        Raises
        ------
        DataError
            The arm has another structure; the message states which condition fails.
        """
        if zero.joints != 4 or sum(zero.turns) != 3:
            raise zero.refused(f"it has {zero.joints} joints, of which {sum(zero.turns)} turn, not 4 and 3")
        for k in range(1, 4):
            if not parallel(zero.axes[0], zero.axes[k]):
                raise zero.refused(f"axes 1 and {k + 1} are not parallel")
        # Right and left are seen from above, whichever way the axes point.
        up = zero.axes[0] * (-1.0 if zero.axes[0][2] < 0.0 else 1.0)
        x = np.eye(3)[int(np.argmin(np.abs(up)))]
        x = x - (x @ up) * up
        x = x / np.linalg.norm(x)
        plane = np.stack([x, np.cross(up, x), up])
        a, b, c = (k for k in range(4) if zero.turns[k])
        upper, fore = (
            _polar(plane @ (zero.points[end] - zero.points[begin])) for begin, end in ((a, b), (b, c))
        )
        if min(upper[1], fore[1]) <= MEETING_MM:
            raise zero.refused("two of its parallel axes coincide")
        senses = np.sign(zero.axes @ up)
        return cls(zero, plane, (a, b, c), zero.turns.index(False), senses, upper, fore)

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """Solve both branches of flange poses (n, 4, 4), base frame, mm.

        A SCARA leaves no joint free: `seed` is not used.
        """
        del seed
        up, flange = self.plane[2], self.zero.flange
        turned = poses[:, :3, :3] @ flange[:3, :3].T
        x, y = self.plane[0], self.plane[1]
        angle = np.arctan2(y @ turned @ x - x @ turned @ y, x @ turned @ x + y @ turned @ y)
        tilted = 1.0 - turned @ up @ up > 0.5 * LEVEL**2
        a, b, c = self.turning
        hand = turns_about(up, angle) @ (self.zero.points[c] - flange[:3, 3])
        end = (poses[:, :3, 3] + hand - self.zero.points[a]) @ self.plane.T
        between, lead, far, stretched = bent((end[:, 0], end[:, 1]), self.upper[1], self.fore[1], _RIGHT)
        joints: list[Array] = [np.zeros(0)] * 4
        turn_a = np.arctan2(end[:, 1], end[:, 0]) - lead - self.upper[0]
        turn_b = between - self.fore[0] + self.upper[0]
        joints[a], joints[b] = self.senses[a] * turn_a, self.senses[b] * turn_b
        joints[c] = self.senses[c] * (angle - turn_a - turn_b)
        joints[self.sliding] = self.senses[self.sliding] * ((poses[:, :3, 3] - flange[:3, 3]) @ up)
        states = ((BranchResult.ELBOW, stretched), (BranchResult.TOO_FAR, far), (BranchResult.TILTED, tilted))
        return Solutions.of(self.branches, joints, states, self.zero.turns, len(poses))


def _polar(in_plane: Array) -> tuple[float, float]:
    return float(np.arctan2(in_plane[1], in_plane[0])), float(np.hypot(in_plane[0], in_plane[1]))


class InvertibleArm(Protocol):
    """An arm that can be inverted: the names of its branches, and its solutions in their order."""

    @property
    def kind(self) -> str:
        """The method of solution and the structure as text: "in closed form, SCARA"."""
        ...

    @property
    def branches(self) -> tuple[str, ...]:
        """Names of the branches."""
        ...

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """Solve all branches of flange poses (n, 4, 4), base frame, mm.

        `seed` (n, N) gives the joints that a pose does not determine.
        """
        ...


_KINDS = {4: Scara, 5: FiveAxes, 6: SixAxes, 7: SevenAxes}


def inverse_kinematics(robot: Robot, poses: Array, *, seed: Array | None = None) -> Solutions:
    """Solve all branches of flange poses.

    Parameters
    ----------
    poses : array of shape (n, 4, 4)
        Flange poses in the base frame, mm.
    seed : array of shape (n, N), optional
        Model joints, rad or mm. Default: 0. They give the joint that a singular pose does not determine,
        the half-plane of the elbow of seven axes, and the position of a track that carries the arm.

    Raises
    ------
    DataError
        There is no inverse kinematics for this robot.
    ValueError
        An array has the wrong shape, or `poses` has numbers that are not finite.
    """
    poses = np.asarray(poses, dtype=np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"poses have shape {poses.shape}; needed (n, 4, 4)")
    if not np.all(np.isfinite(poses)):
        raise ValueError("poses hold numbers that are not finite")
    shape = len(poses), robot.joints
    seed = np.zeros(shape) if seed is None else np.asarray(seed, dtype=np.float64)
    if seed.shape != shape:
        raise ValueError(f"seed has shape {seed.shape}; needed {shape}")
    return arm_of(robot).solve(poses, seed)


def arm_of(robot: Robot) -> InvertibleArm:
    """Find the structure of a nominal robot.

    Raises
    ------
    DataError
        The robot has no known structure; the message states which condition fails.
    """
    return _arm_of(ZeroPose.of(robot))


def _arm_of(zero: ZeroPose) -> InvertibleArm:
    kind = _KINDS.get(zero.joints)
    try:
        if kind is None:
            raise zero.refused(f"it has {zero.joints} joints")
        return kind.of(zero)
    except DataError as why:
        if zero.joints == 6 and all(zero.turns):
            found = OffsetWrist.of(zero)
            if found is not None:
                return found
        elif zero.joints > 4:
            try:
                return ArmOnAxis(zero, _arm_of(zero.without_first()))
            except DataError:
                pass
        raise why


@dataclass(frozen=True)
class ArmOnAxis:
    """An arm, and the first axis of its zero pose, which carries it."""

    zero: ZeroPose
    arm: InvertibleArm

    @property
    def kind(self) -> str:
        """The kind of the arm, and that joint 1 is not solved for."""
        return f"{self.arm.kind}; joint 1 stays where it stands"

    @property
    def branches(self) -> tuple[str, ...]:
        """The branches of the arm."""
        return self.arm.branches

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """Solve all branches of the arm for flange poses (n, 4, 4), mm.

        The first column of `seed` (n, N) is the position of the external axis.
        """
        moved = self.zero.moved(0, seed[:, 0])
        back = np.zeros_like(moved)
        back[:, :3, :3] = moved[:, :3, :3].transpose(0, 2, 1)
        back[:, :3, 3:] = -back[:, :3, :3] @ moved[:, :3, 3:]
        back[:, 3, 3] = 1.0
        found = self.arm.solve(back @ poses, seed[:, 1:])
        stands = np.where(found.valid, seed[:, :1], np.nan)
        return Solutions(
            np.concatenate([stands[:, :, None], found.joints], axis=2), found.state, found.branches
        )
