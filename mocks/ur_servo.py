"""Target and actual joints of a simulated UR arm: the actual ones trail, as behind any servo.

The targets are those of the ArmDevice. The actual angle follows the target as a first-order lag, so that the
controller has ended its program while the arm still creeps the last tenths of a degree: a read-back taken then
is wrong. Read back in steps of `COUNT_RAD`, a choice of this simulator.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from mocks.arm_device import ArmDevice

LAG_S = 0.05
COUNT_RAD = 1e-5
Vector = tuple[float, ...]


class Servo:
    """Angles in rad and rad/s at the simulated time of the arm."""

    def __init__(self, arm: ArmDevice) -> None:
        self.arm = arm
        self._speed: Vector = (0.0,) * 6
        self._start_s = self._rest_s = 0.0
        self._end_s = 0.0
        self._resting = True

    def start(self, goal_deg: Sequence[float], rate_deg_s: float) -> None:
        """Begin a move of the arm."""
        here = self.arm.joints_deg()
        self._start_s = self.arm.now()
        self.arm.start(goal_deg, rate_deg_s=rate_deg_s, tool_mm_s=math.inf)
        seconds = max(self.arm.left_s, 1e-9)
        self._speed = tuple(math.radians(b - a) / seconds for a, b in zip(here, goal_deg, strict=True))
        self._end_s = self._start_s + seconds
        self._resting = False

    def _grown(self, until: float) -> float:
        """How much of its full trail the actual arm had at a time of the move."""
        return 1.0 - math.exp(-max(until - self._start_s, 0.0) / LAG_S)

    def _share(self) -> float:
        """Trail now over the full one; in a first-order lag also the actual speed over the move's."""
        now = self.arm.now()
        if self.arm.moving:
            return self._grown(now)
        if not self._resting:
            self._resting, self._rest_s = True, min(now, self._end_s)
        return self._grown(self._rest_s) * math.exp(-(now - self._rest_s) / LAG_S)

    def target(self) -> Vector:
        return tuple(map(math.radians, self.arm.joints_deg()))

    def target_speed(self) -> Vector:
        return self._speed if self.arm.moving else (0.0,) * 6

    def actual(self) -> Vector:
        trail = LAG_S * self._share()
        angles = (q - v * trail for q, v in zip(self.target(), self._speed, strict=True))
        return tuple(round(q / COUNT_RAD) * COUNT_RAD for q in angles)

    def actual_speed(self) -> Vector:
        return tuple(v * self._share() for v in self._speed)
