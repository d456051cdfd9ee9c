"""Arm of a simulated robot without a protocol: joint angles as a function of simulated time.

A move runs linearly in time on all joints together and lasts max|dq| / rate, or longer when the speed of the
tool demands it. The side from which a joint arrived is the direction of its own last motion. A joint that does
not move keeps its side.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum

from mocks.shared.clock import Past

REACH_MM = 700.0  # lever that turns the rate of joints 1 to 3 into a speed of the tool, roughly
_STILL_DEG = 1e-9


class Outcome(Enum):
    """Ways in which a move can end."""

    ARRIVED = "arrived"
    STOPPED = "stopped"  # by a stop command or the watchdog
    DEAD = "dead"  # emergency stop or supervision: the motion task hangs until it is restarted


@dataclass(frozen=True)
class Move:
    """Linear motion between two postures in deg, from one simulated time in s to another."""

    start_deg: tuple[float, ...]
    goal_deg: tuple[float, ...]
    start_s: float
    end_s: float
    trail_deg: tuple[float, ...]  # by which the servos were behind when it began

    def joints_deg(self, at_s: float) -> tuple[float, ...]:
        if at_s >= self.end_s:
            return self.goal_deg
        if at_s <= self.start_s:
            return self.start_deg
        share = (at_s - self.start_s) / (self.end_s - self.start_s)
        return tuple(a + share * (b - a) for a, b in zip(self.start_deg, self.goal_deg, strict=True))

    @property
    def speed_deg_s(self) -> tuple[float, ...]:
        seconds = self.end_s - self.start_s
        return tuple(
            (b - a) / seconds if seconds > 0 else 0.0
            for a, b in zip(self.start_deg, self.goal_deg, strict=True)
        )

    def cut(self, at_s: float) -> Move:
        """Return the move that ends at the position of the arm at a time."""
        return (
            self
            if at_s >= self.end_s
            else replace(self, goal_deg=self.joints_deg(at_s), end_s=max(at_s, self.start_s))
        )


@dataclass
class ArmDevice:
    """State of arm and controller panel. Times in simulated seconds, angles in degrees, mm of joints that slide.

    `limits_deg` hold for the joints as the controller counts; all else is of the model's joints.
    """

    now: Callable[[], float]
    limits_deg: Sequence[tuple[float, float]]
    sliding: Sequence[bool] = ()  # none if empty
    mode: str = "auto"  # or "manual", "manual_full"
    motors_on: bool = True
    emergency_stop: bool = False
    hung: bool = False  # motion task stopped by supervision
    previous_deg: tuple[float, ...] = ()
    sides: tuple[int, ...] = ()
    changed: asyncio.Event = field(default_factory=asyncio.Event)
    sent_to: list[tuple[float, ...]] = field(default_factory=list)  # targets of all moves that began
    servos_behind_deg: Callable[[], tuple[float, ...]] | None = None

    def __post_init__(self) -> None:
        joints = len(self.limits_deg)
        nought = (0.0,) * joints
        self.previous_deg, self.sides = nought, (1,) * joints
        self.sliding = self.sliding or (False,) * joints
        self._moves = Past(self.now, Move(nought, nought, 0.0, 0.0, nought))

    @property
    def move(self) -> Move:
        """The move that runs, or the last one."""
        return self._moves.value

    @property
    def moves(self) -> int:
        """Number of moves that have begun.

        The rest position of the arm, and its error, belong to the last of them.
        """
        return len(self.sent_to)

    def joints_deg(self) -> tuple[float, ...]:
        """Return the current commanded joint angles of the arm, deg."""
        return self.move.joints_deg(self.now())

    def actual_deg(self) -> tuple[float, ...]:
        """Return the actual joint angles of the arm, which trail the commanded ones, deg."""
        return tuple(q - behind for q, behind in zip(self.joints_deg(), self.trail_deg(), strict=True))

    def trail_deg(self) -> tuple[float, ...]:
        """Return the angles by which the servos trail."""
        return (0.0,) * len(self.limits_deg) if self.servos_behind_deg is None else self.servos_behind_deg()

    @property
    def moving(self) -> bool:
        return self.now() < self.move.end_s

    @property
    def left_s(self) -> float:
        return max(0.0, self.move.end_s - self.now())

    @property
    def can_move(self) -> bool:
        return self.mode == "auto" and self.motors_on and not self.emergency_stop and not self.hung

    def within_limits(self, target: Sequence[float]) -> bool:
        return all(low <= q <= high for q, (low, high) in zip(target, self.limits_deg, strict=True))

    def start(self, target: Sequence[float], rate_deg_s: float, tool_mm_s: float) -> None:
        """Begin a move to `target`."""
        here = self.joints_deg()
        moved = [abs(b - a) for a, b in zip(here, target, strict=True)]
        far = [0.0 if slides else q for q, slides in zip(moved, self.sliding, strict=True)]
        slid_mm = max(q if slides else 0.0 for q, slides in zip(moved, self.sliding, strict=True))
        tool_mm = max(REACH_MM * max(far[:3]) * 0.0174533, slid_mm)
        self.previous_deg = here
        self.sides = tuple(
            (1 if b > a else -1) if abs(b - a) > _STILL_DEG else side
            for a, b, side in zip(here, target, self.sides, strict=True)
        )
        self.sent_to.append(tuple(target))
        now = self.now()
        seconds = max(max(far) / rate_deg_s, tool_mm / tool_mm_s)
        self._moves.change(Move(here, tuple(target), now, now + seconds, self.trail_deg()))
        self.wake()

    def halt(self) -> None:
        """Stop the arm where it is now."""
        self._moves.change(self.move.cut(self.now()))
        self.wake()

    def put(self, joints_deg: Sequence[float]) -> None:
        """Set the joint angles of the arm without a move."""
        here = tuple(joints_deg)
        self._moves.change(Move(here, here, self.now(), self.now(), (0.0,) * len(here)))
        self.changed.set()

    def press_emergency_stop(self) -> None:
        self.emergency_stop, self.motors_on, self.hung = True, False, True
        self.halt()

    def supervise(self) -> None:
        """Motion supervision stops the task: the arm halts, and the program no longer answers."""
        self.hung = True
        self.halt()

    def restart(self) -> None:
        """Emergency stop released, motors on, program pointer to main."""
        self.emergency_stop, self.motors_on, self.hung = False, True, False
        self.wake()

    def wake(self) -> None:
        """Wake the threads that wait for a change."""
        self.changed.set()
