"""Simulated Fanuc controller without its protocols: joint angles, speeds, alarms, moves.

The arm of the cell turns by the angles of the kinematic model. A Fanuc counts joint 3 from the horizontal, and
joints 4 to 6 the other way round (`Robot.counting`). Its limits hold for its own angles.
"""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from enum import Enum

from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import CellClock
from mocks.world.kinematics import frames, nominal_geometry
from mocks.world.robots import Robot

MAX_DEG_S = (350.0, 350.0, 400.0, 450.0, 450.0, 720.0)
CNT_LEAD_S = 0.15  # a CNT move is over for the program while the arm still runs out
NO_CAP_MM_S = 1e9  # a joint move has no cap on the speed of the tool


class End(Enum):
    """Ways in which a move can end."""

    ARRIVED = "arrived"
    STOPPED = "stopped"
    SILENT = "silent"  # watchdog
    UNFIT = "unfit"  # emergency stop, servo off, pendant enabled, supervision


class FanucController:
    """One controller over the cell's arm."""

    def __init__(self, arm: ArmDevice, clock: CellClock, robot: Robot) -> None:
        self.arm = arm
        self.clock = clock
        self.robot = robot
        self.alarm = (0, 0)  # facility and number of the active one
        self.last_word = time.monotonic()  # of the client; the watchdog guards the link, so: on the wall
        self.beat_s = 0.0
        self.cnt_lead_s = CNT_LEAD_S
        self._stop_asked = False

    # -- angles -------------------------------------------------------------------------------------------

    def to_model(self, q: Sequence[float]) -> tuple[float, ...]:
        """Return the angles of the model, deg, for angles of the controller."""
        return self.robot.counting.to_model(q)

    def joints_deg(self) -> tuple[float, ...]:
        """Return the current joint angles of the arm, as the controller counts them, deg."""
        return self.robot.counting.counted(self.arm.joints_deg())

    def pose(self) -> tuple[float, ...]:
        """Return x, y, z (mm) and w, p, r (deg) of the nominal flange.

        The origin is at the height of joint 2. The rotation is Rz(r) Ry(p) Rx(w).
        """
        angles = self.robot.internal(self.arm.joints_deg())
        flange = frames(self.robot.convention, nominal_geometry(self.robot), angles)[-1]
        x, y, z = (float(value) for value in flange[:3, 3])
        w = math.atan2(flange[2, 1], flange[2, 2])
        p = math.atan2(-flange[2, 0], math.hypot(flange[2, 1], flange[2, 2]))
        r = math.atan2(flange[1, 0], flange[0, 0])
        return x, y, z - self.robot.links[0].d_mm, *(math.degrees(angle) for angle in (w, p, r))

    def within_limits(self, target: Sequence[float]) -> bool:
        return self.arm.within_limits(target)

    # -- state --------------------------------------------------------------------------------------------

    @property
    def fit(self) -> bool:
        """Servo on, pendant off, no alarm that stops motion."""
        return self.arm.can_move

    def current_alarm(self) -> tuple[int, int]:
        """Return the current alarm, or (0, 0) if there is none.

        Simulated alarms are emergency stop of the panel, fence open, pendant enabled and collision.
        """
        if self.fit:
            return (0, 0)
        if self.arm.emergency_stop:
            return (11, 1)
        if not self.arm.motors_on:
            return (11, 4)
        if self.arm.mode != "auto":
            return (24, 42)
        return self.alarm if self.alarm != (0, 0) else (11, 50)

    def raise_alarm(self, facility: int, number: int) -> None:
        self.alarm = (facility, number)
        self.arm.supervise()

    def stop(self) -> None:
        """Halt the arm on a client's stop."""
        self._stop_asked = True
        self.arm.halt()

    # -- motion -------------------------------------------------------------------------------------------

    async def move(self, target: Sequence[float], percent: float, *, cnt: bool = False) -> End:
        """Move the joints to a target at `percent` of their speeds.

        With `cnt`, the move ends before the arm is at rest.
        """
        arm, here = self.arm, self.joints_deg()
        if not self.fit:
            return End.UNFIT
        self._stop_asked, self.alarm = False, (0, 0)
        share = max(percent, 0.01) / 100.0
        seconds = max(abs(b - a) / (share * top) for a, b, top in zip(here, target, MAX_DEG_S, strict=True))
        model = self.to_model(target)
        far = max(abs(b - a) for a, b in zip(arm.joints_deg(), model, strict=True))
        arm.start(model, rate_deg_s=far / seconds if far > 0.0 < seconds else 1.0, tool_mm_s=NO_CAP_MM_S)
        lead_s = self.cnt_lead_s if cnt else 0.0
        silent = False
        self.last_word = time.monotonic()
        while True:
            arm.changed.clear()
            if not arm.can_move:
                arm.supervise()
                return End.UNFIT
            if self._stop_asked or silent:
                return End.SILENT if silent else End.STOPPED
            if arm.left_s <= lead_s:
                return End.ARRIVED
            silent = await self._pause(arm.left_s - lead_s)

    async def _pause(self, seconds: float) -> bool:
        """Wait for the end of the move or a change.

        Returns True if the client has been silent for too long.
        """
        if self.beat_s:
            left = self.last_word + self.beat_s - time.monotonic()
            if left <= 0:
                self.arm.halt()
                return True
            seconds = min(seconds, left * self.clock.time_scale)
        await self.clock.wait(seconds, self.arm.changed)
        return False

    async def until_restart(self) -> None:
        """Answer nothing until the alarm is reset and the paused program started again."""
        while self.arm.hung:
            self.arm.changed.clear()
            await self.arm.changed.wait()
        raise ConnectionResetError("programs started again")
