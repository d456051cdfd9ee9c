"""Moves of a UR arm: a URScript program is sent, then the states are watched until the arm stands.

Nothing acknowledges a program. A move has ended when no program runs and target and actual joints agree and
stand; then it is judged by where. A program over RTDE carries a number, which comes back in a register when it
begins, and a watchdog. URScript: Universal Robots, "The URScript Programming Language", movej, stopj,
rtde_set_watchdog, write_output_integer_register.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass

from drivers.errors import (
    AcquisitionError,
    Busy,
    LinkError,
    LinkTimeout,
    MotionStopped,
    NotReached,
    WrongMode,
)
from drivers.ur_deadlines import UrDeadlines
from drivers.ur_realtime import Realtime
from drivers.ur_rtde import REGISTER, Rtde
from drivers.ur_state import AGREE_RAD, PAUSED, PLAYING, STOPPED, UrState, Vector, Witness, unfit

_LEVERS = (1.0, 1.0, 0.6, 0.3, 0.3, 0.15)  # from each axis to the end of the tool, arm outstretched
_STOP_RAD_S2 = 4.0
_LOOK_S = 0.25
_LAST_NUMBER = 2**31 - 1


@dataclass(frozen=True, slots=True)
class Limits:
    """How fast the arm may move, and how near to its goal it has to stand; mm/s, mm, rad/s, rad/s2, rad, s."""

    speed_mm_s: float
    reach_mm: float
    speed: float
    acceleration: float
    tolerance: float
    watchdog_s: float


def move_program(
    goal_rad: Sequence[float], acceleration: float, speed: float, number: int | None, watchdog_s: float
) -> str:
    """URScript that moves to `goal_rad`, rad/s2 and rad/s of the leading joint; with `number`, it reports."""
    goal = ", ".join(f"{q:.8f}" for q in goal_rad)
    lines = [f"movej([{goal}], a={acceleration:.6f}, v={speed:.6f})"]
    if number is not None:
        lines = [
            f'rtde_set_watchdog("input_int_register_{REGISTER}", {1 / watchdog_s:.3f}, "stop")',
            f"write_output_integer_register({REGISTER}, {number})",
            *lines,
        ]
    return "".join(["def truepose():\n", *(f"  {line}\n" for line in lines), "end\n"])


def not_ready(state: UrState) -> AcquisitionError | None:
    """Why no program may be sent now, or None."""
    problem = unfit(state, moving=False)
    if problem is None and not (state.runtime_state == STOPPED and state.stands):
        return Busy(
            "a program runs or is paused on the controller, or the arm moves",
            raw=state.shown,
            what_to_do="Stop the program on the pendant and let go of the arm, then confirm.",
        )
    return problem


def _begun(state: UrState, here: UrState, number: int | None) -> bool:
    """Whether the program sent has begun: by its number, else because the controller does something."""
    if number is not None:
        return state.echo == number
    moved = max(abs(a - b) for a, b in zip(state.target_rad, here.target_rad, strict=True))
    return state.runtime_state == PLAYING or moved > 2 * AGREE_RAD


class Motion:
    """Moves, one at a time, and `halt` from any thread. `stopped`: stopped or disconnected since the arming."""

    def __init__(self, realtime: Realtime, name: str, limits: Limits, clock: Callable[[], float]) -> None:
        self.stopped = threading.Event()
        self._realtime = realtime
        self._name = name
        self._limits = limits
        self._clock = clock
        self._sending = threading.Lock()

    @property
    def _deadlines(self) -> UrDeadlines:
        return self._realtime.deadlines

    def move(self, feed: Rtde | Realtime, goal: Vector) -> tuple[UrState, AcquisitionError | None]:
        """A whole move to `goal` (rad), watched on `feed`: where it ended, and what is wrong with that."""
        with feed.watch("move_to", guarding=True) as witness:
            state = witness.state()
            problem = not_ready(state)
            if problem is not None:
                return state, problem
            with ExitStack() as undo:
                undo.callback(self._halt_if_possible)  # however this ends, the arm shall stand
                problem = self._begin(feed.numbered, witness, state, goal)
                if problem is None:
                    state, problem = self._follow(witness, goal, self._move_seconds(state, goal))
                if problem is None:
                    undo.pop_all()
        return state, problem

    def halt(self) -> None:
        """Say stop until the arm stands; a disconnect in between does not end it. Raises LinkError."""
        seconds = self._deadlines.stop_s
        end = self._clock() + seconds
        with self._realtime.talk("stop", outlives_close=True) as (witness, send):
            next_word = -math.inf
            while self._clock() < end:
                if self._clock() >= next_word:
                    next_word = self._clock() + _LOOK_S
                    with self._sending:
                        send(f"stopj({_STOP_RAD_S2:g})\n")
                state = witness.state()
                if state.stands and state.runtime_state in (STOPPED, PAUSED):
                    return
        raise LinkTimeout(
            f"the arm did not stand within stop_s = {seconds:g} s", device=self._name, command="stop"
        )

    def _halt_if_possible(self) -> None:
        with suppress(LinkError):
            self.halt()

    def _begin(
        self, numbered: bool, witness: Witness, here: UrState, goal: Vector
    ) -> AcquisitionError | None:
        """Send the program and see it begin."""
        number = None
        if numbered and here.echo is not None:
            number = here.echo % _LAST_NUMBER + 1  # what the register does not hold yet
        script = move_program(
            goal, self._limits.acceleration, self._capped(here, goal), number, self._limits.watchdog_s
        )
        with self._realtime.talk("move_to") as (_, send):
            with self._sending:  # a stop comes first and nothing is sent, or later and ends what was sent
                if self.stopped.is_set():
                    return MotionStopped("stopped before it began")
                send(script)
            end = self._clock() + self._deadlines.start_s
            while True:
                state = witness.state()
                problem = unfit(state, moving=True)
                if problem is not None or _begun(state, here, number):
                    return problem
                if self._clock() < end:
                    continue
                if self.stopped.is_set():
                    return MotionStopped("stopped before it began", raw=state.shown)
                if number is None and state.off_rad(goal) <= self._limits.tolerance:
                    return None  # already there: too short a program to be seen
                return WrongMode(
                    f"program did not begin within start_s = {self._deadlines.start_s:g} s",
                    raw=state.shown,
                    what_to_do="Switch the controller to remote control on the pendant (e-Series), then confirm.",
                )

    def _follow(
        self, witness: Witness, goal: Vector, seconds: float
    ) -> tuple[UrState, AcquisitionError | None]:
        """States until the arm stands at the end of its program."""
        end = self._clock() + seconds
        rest_since = math.inf
        while True:
            state = witness.state()
            problem = unfit(state, moving=True)
            if problem is not None:
                return state, problem
            now = self._clock()
            if state.runtime_state == STOPPED and state.stands:
                rest_since = min(rest_since, now)
                settled = state.off_rad(state.target_rad) <= self._limits.tolerance
                if settled or now - rest_since > self._deadlines.settle_s:
                    return state, self._judge(state, goal)
            else:
                rest_since = math.inf
                if self.stopped.is_set():
                    self.halt()  # the stop may have overtaken the move: say it again
            if now > end:
                return state, NotReached(
                    f"not there within move_s = {seconds:.1f} s: program paused, or speed slider low?",
                    raw=state.shown,
                )

    def _judge(self, state: UrState, goal: Vector) -> AcquisitionError | None:
        """What is wrong with standing in `state` after a move to `goal`."""
        if self.stopped.is_set():
            return MotionStopped("stopped on its way", raw=state.shown)
        off = state.off_rad(goal)
        if off <= self._limits.tolerance:
            return None
        text = f"stands {math.degrees(off):.3f} deg from where it was sent"
        if max(abs(a - b) for a, b in zip(state.target_rad, goal, strict=True)) > self._limits.tolerance:
            return MotionStopped(f"program ended before its target, {text}", raw=state.shown)
        return NotReached(text, raw=state.shown)

    def _capped(self, here: UrState, goal: Vector) -> float:
        """Speed of the leading joint, rad/s. movej knows no speed of the tool: the sum of all levers bounds it."""
        far = [abs(a - b) for a, b in zip(here.actual_rad, goal, strict=True)]
        way_mm = self._limits.reach_mm * sum(lever * q for lever, q in zip(_LEVERS, far, strict=True))
        return min(self._limits.speed, self._limits.speed_mm_s * max(far) / max(way_mm, 1e-9))

    def _move_seconds(self, here: UrState, goal: Vector) -> float:
        speed = self._capped(here, goal)
        predicted = here.off_rad(goal) / speed + speed / self._limits.acceleration
        return self._deadlines.move_factor * predicted + self._deadlines.move_margin_s
