"""Target and actual joints of a simulated UR arm, whose actual joints trail the targets.

The targets are those of the ArmDevice. The actual angle follows the target as a first-order lag, as behind any
servo. The controller therefore ends its program while the arm still creeps the last tenths of a degree, and a
read-back taken then is wrong. Angles are read back in steps of `COUNT_RAD`, a choice of this simulator.
"""

from __future__ import annotations

import math

from mocks.shared.arm_device import ArmDevice

LAG_S = 0.05
COUNT_RAD = 1e-5
Vector = tuple[float, ...]


class Servo:
    """Joint angles and speeds in rad and rad/s at the simulated time of the arm.

    They depend only on that time and on the move.
    """

    def __init__(self, arm: ArmDevice) -> None:
        self.arm = arm
        arm.servos_behind_deg = lambda: tuple(map(math.degrees, self.trail()))

    def target(self) -> Vector:
        return tuple(map(math.radians, self.arm.joints_deg()))

    def target_speed(self) -> Vector:
        move = self.arm.move
        under_way = move.start_s <= self.arm.now() < move.end_s
        return tuple(map(math.radians, move.speed_deg_s)) if under_way else (0.0,) * 6

    def trail(self) -> Vector:
        """Return the distances of the joints behind their targets, rad."""
        move, now = self.arm.move, self.arm.now()
        begun_s = max(now - move.start_s, 0.0)
        over_s = max(now - move.end_s, 0.0)
        fresh_s = LAG_S * (math.exp(-over_s / LAG_S) - math.exp(-begun_s / LAG_S))
        old = math.exp(-begun_s / LAG_S)
        return tuple(
            math.radians(speed * fresh_s + behind * old)
            for speed, behind in zip(move.speed_deg_s, move.trail_deg, strict=True)
        )

    def actual(self) -> Vector:
        angles = (q - behind for q, behind in zip(self.target(), self.trail(), strict=True))
        return tuple(round(q / COUNT_RAD) * COUNT_RAD for q in angles)

    def actual_speed(self) -> Vector:
        return tuple(behind / LAG_S for behind in self.trail())
