"""Arm and tool of a cell as capsules that move with the joints, and bounds of their motion.

While all joints turn in proportion, p(s) of a point bends away from its chord over a share w of the move by at most

    max |p''| w^2 / 8,    |p''| <= sum_j L_j |dq_j| (|dq_j| + 2 sum_{i<j} |dq_i|),

since d2p / dq_i dq_j = z_i x (z_j x (p - o_j)), i <= j, is no longer than the distance of the point from axis j. L_j is
the largest such distance in any posture, the sum of the lengths of the links between. A joint j that slides moves all
behind it by its unit vector z_j, which only those before it turn: |dq_j| 2 sum_{i<j} |dq_i| over the i that turn.
Joints in deg, or in mm if they slide; lengths in mm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.arm import BasePoses, Capsule, Chain, Robot, nominal_values, propagate

Array = NDArray[np.float64]
# Radius of the carrier of a target, if the cell file does not state it; an SMR of 1.5 inches has 19
TOOL_RADIUS_MM = 25.0


@dataclass(frozen=True)
class CellArm:
    """The nominal robot's body and its tool: a capsule from the flange to every target."""

    robot: Robot
    coupling: str
    capsules: tuple[Capsule, ...]

    @classmethod
    def of(
        cls, robot: Robot, coupling: str, targets: Mapping[str, tuple[float, float, float]], radius_mm: float
    ) -> CellArm:
        """Return the arm of `robot` with a tool that has these targets (flange frame)."""
        tool = (
            Capsule(f"the tool at {name}", robot.joints, (0.0, 0.0, 0.0), point, radius_mm)
            for name, point in targets.items()
        )
        return cls(robot, coupling, (*robot.body, *tool))

    def lines(self, joints_deg: Array) -> Array:
        """Compute the centre lines (n, c, 2, 3), mm, of the c capsules.

        The joint angles (n, N) are those of the controller.
        """
        joints = self.robot.model_angles(np.asarray(joints_deg) * self.robot.joint_units, self.coupling)
        frames = propagate(Chain.of(self.robot), nominal_values(self.robot, joints), BasePoses(), record=())
        out = np.empty((len(self.capsules), 2, 3, len(joints)))
        for i, capsule in enumerate(self.capsules):
            x, y, z, origin = frames.link_frames[capsule.link - 1]
            for k, (a, b, c) in enumerate((capsule.from_mm, capsule.to_mm)):
                out[i, k] = origin + a * x + b * y + c * z
        return out.transpose(3, 0, 1, 2)

    @cached_property
    def radii(self) -> Array:
        """Radii of the capsules, shape (c,), mm."""
        return np.array([capsule.radius_mm for capsule in self.capsules])

    @cached_property
    def links(self) -> NDArray[np.int64]:
        """The link (1-based) with which each capsule moves, shape (c,)."""
        return np.array([capsule.link for capsule in self.capsules])

    @cached_property
    def _levers(self) -> Array:
        """Largest distance of each centre line from each axis, shape (c, N), mm.

        It is 0 for the axes behind the capsule.
        """
        count, dh = self.robot.joints, self.robot.convention == "dh"
        slides = np.array([kind == "slides" for kind in self.robot.kinds])
        ends = np.array([self.robot.lower, self.robot.upper])
        travel = np.where(slides, np.abs(ends).max(axis=0), 0.0)
        lengths = np.hypot(self.robot.a, np.abs(self.robot.d) + travel)
        levers = np.zeros((len(self.capsules), count))
        for i, capsule in enumerate(self.capsules):
            k = capsule.link - 1
            far = max(float(np.linalg.norm(end)) for end in (capsule.from_mm, capsule.to_mm))
            for j in range(k + 1):
                # Frame j lies behind joint j and its link in Denavit's convention, on its axis in Craig's.
                between = lengths[j : k + 1] if dh else lengths[j + 1 : k + 1]
                levers[i, j] = far + float(np.sum(between))
        return levers

    def bends(self, start_deg: Array, goal_deg: Array) -> Array:
        """Bound |p''| over straight moves in joint space, shape (n, c), mm.

        The moves go from (n, N) to (n, N), with s from 0 to 1.
        """
        units = self.robot.joint_units
        ends = [self.robot.model_angles(np.asarray(q) * units, self.coupling) for q in (start_deg, goal_deg)]
        slides = np.array([kind == "slides" for kind in self.robot.kinds])
        moved = np.abs(ends[1] - ends[0])
        turns, slid = np.where(slides, 0.0, moved), np.where(slides, moved, 0.0)
        before = np.cumsum(turns, axis=1) - turns
        carried = np.arange(1, self.robot.joints + 1) <= self.links[:, None]
        return (turns * (turns + 2.0 * before)) @ self._levers.T + (2.0 * slid * before) @ carried.T
