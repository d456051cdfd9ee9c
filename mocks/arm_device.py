"""The arm of a simulated robot apart from any wire protocol: joint angles as a function of simulated time.

A move runs linearly in time on all joints together and lasts max|dq| / rate, or longer when the speed of the
tool demands it. The side from which a joint arrived is the direction of its own last motion; a joint that
does not move keeps its side.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from enum import Enum

REACH_MM = 700.0  # lever that turns the rate of joints 1 to 3 into a speed of the tool, roughly
_STILL_DEG = 1e-9


class Outcome(Enum):
    """How a move ended."""

    ARRIVED = "arrived"
    STOPPED = "stopped"  # by a stop command or the watchdog
    DEAD = "dead"  # emergency stop or supervision: the motion task hangs until it is restarted


@dataclass
class ArmDevice:
    """State of arm and controller panel. Times in simulated seconds, angles in degrees."""

    now: Callable[[], float]
    limits_deg: Sequence[tuple[float, float]]
    mode: str = "auto"  # or "manual", "manual_full"
    motors_on: bool = True
    emergency_stop: bool = False
    hung: bool = False  # motion task stopped by supervision
    previous_deg: tuple[float, ...] = (0.0,) * 6
    sides: tuple[int, ...] = (1,) * 6
    changed: asyncio.Event = field(default_factory=asyncio.Event)
    sent_to: list[tuple[float, ...]] = field(default_factory=list)  # targets of all moves that began
    _from: tuple[float, ...] = (0.0,) * 6
    _to: tuple[float, ...] = (0.0,) * 6
    _start_s: float = 0.0
    _end_s: float = 0.0

    def joints_deg(self) -> tuple[float, ...]:
        """Where the arm is now."""
        now = self.now()
        if now >= self._end_s:
            return self._to
        share = (now - self._start_s) / (self._end_s - self._start_s)
        return tuple(a + share * (b - a) for a, b in zip(self._from, self._to, strict=True))

    @property
    def moving(self) -> bool:
        return self.now() < self._end_s

    @property
    def left_s(self) -> float:
        return max(0.0, self._end_s - self.now())

    @property
    def can_move(self) -> bool:
        return self.mode == "auto" and self.motors_on and not self.emergency_stop and not self.hung

    def within_limits(self, target: Sequence[float]) -> bool:
        return all(low <= q <= high for q, (low, high) in zip(target, self.limits_deg, strict=True))

    def start(self, target: Sequence[float], rate_deg_s: float, tool_mm_s: float) -> None:
        """Begin a move to `target`."""
        here = self.joints_deg()
        far = [abs(b - a) for a, b in zip(here, target, strict=True)]
        tool_mm = REACH_MM * max(far[:3]) * 0.0174533
        self.previous_deg = here
        self.sides = tuple(
            (1 if b > a else -1) if abs(b - a) > _STILL_DEG else side
            for a, b, side in zip(here, target, self.sides, strict=True)
        )
        self._from, self._to = here, tuple(target)
        self.sent_to.append(self._to)
        self._start_s = self.now()
        self._end_s = self._start_s + max(max(far) / rate_deg_s, tool_mm / tool_mm_s)
        self.wake()

    def halt(self) -> None:
        """Stand still where the arm is now."""
        self._from = self._to = self.joints_deg()
        self._end_s = self._start_s
        self.wake()

    def press_emergency_stop(self) -> None:
        self.emergency_stop, self.motors_on, self.hung = True, False, True
        self.halt()

    def supervise(self) -> None:
        """Motion supervision stops the task: the arm stands, nobody answers."""
        self.hung = True
        self.halt()

    def restart(self) -> None:
        """Emergency stop released, motors on, program pointer to main."""
        self.emergency_stop, self.motors_on, self.hung = False, True, False
        self.wake()

    def wake(self) -> None:
        """Let whoever waits for a change look again."""
        self.changed.set()
