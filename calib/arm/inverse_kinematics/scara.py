"""SCARA: three axes that turn and one that slides, all parallel, in any order (RRPR, RRRP, PRRR).

Motions along and about parallel axes can be exchanged, so only the order of the three that turn counts: u the common
direction, a, b, c the points of the axes across it.

    turn    theta_a + theta_b + theta_c = angle of R about u (each by its sense)
    elbow   |c' - a|^2 = |ab|^2 + |bc|^2 + 2 |ab| |bc| cos(theta_b + phi)   gives theta_b, right and left, then theta_a
    slide   what the flange is raised along u

Source: Craig, Introduction to Robotics, 4.4 (two links in a plane).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.inverse_kinematics.solutions import Reached, Solutions
from calib.arm.inverse_kinematics.two_links import bent
from calib.arm.inverse_kinematics.zero_pose import MEETING_MM, ZeroPose, parallel, turns_about
from calib.array import Array

LEVEL = 1e-4
"""rad: a tilt that a pose may ask for by its rounding; the arm leaves it out."""

_RIGHT = np.array([1.0, -1.0]).reshape(2, 1)


@dataclass(frozen=True)
class Scara:
    """The zero pose of a SCARA. plane: rows x, y, u. turning: joints a, b, c (from 0); sliding: the one that slides.

    senses: +1 or -1 for each joint along u. upper, fore: from a to b and b to c, angle and length, rad and mm.
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
        """Raises DataError, saying what prevents it, for other arms."""
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
        """Both branches of flange poses (n, 4, 4), base frame, mm. A SCARA leaves no joint free: `seed` is not used."""
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
        states = ((Reached.ELBOW, stretched), (Reached.TOO_FAR, far), (Reached.TILTED, tilted))
        return Solutions.of(self.branches, joints, states, self.zero.turns, len(poses))


def _polar(in_plane: Array) -> tuple[float, float]:
    return float(np.arctan2(in_plane[1], in_plane[0])), float(np.hypot(in_plane[0], in_plane[1]))
