"""Moves of a UR arm: a URScript program is sent, then the states are watched until rest.

Nothing acknowledges a program. A move has ended when no program runs and target and actual joints agree and are at
rest. Then its end is judged: the controller's own target must be the one that was sent, and the joints must be held
there. A program over RTDE has a number and a watchdog. It writes its arguments into registers, which the driver
compares, and moves when an input register holds its number: a damaged program moves nothing.
URScript: Universal Robots, "The URScript Programming Language", movej, stopj, rtde_set_watchdog,
write_output_float_register, write_output_integer_register, read_input_integer_register.
"""

from __future__ import annotations

import math
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass, replace

from drivers.errors import (
    AcquisitionError,
    Busy,
    LinkError,
    LinkTimeout,
    MotionStopped,
    NotReached,
    ProtocolError,
    WrongMode,
)
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.rtde import FIRST_ARGUMENT, GO_REGISTER, REGISTER, Rtde
from drivers.ur.script_port import ScriptPort
from drivers.ur.state import AGREE_RAD, PAUSED, PLAYING, STOPPED, StateConfirmer, UrState, Vector, unfit

_LEVERS = (1.0, 1.0, 0.6, 0.3, 0.3, 0.15)  # from each axis to the end of the tool, arm outstretched
STOP_SCRIPT = "stopj(4)\n"  # rad/s2
_LOOK_S = 0.25
_LAST_NUMBER = 2**31 - 1
_WRITTEN = 1e-9  # a number of a program, read by the controller, against the same text read here
_COMMANDED_RAD = 1e-5  # the controller's target at the end of a movej; 0.0006 deg


def _same(one: Sequence[float], other: Sequence[float], within: float) -> bool:
    return len(one) == len(other) and max(abs(a - b) for a, b in zip(one, other, strict=True)) <= within


@dataclass(frozen=True, slots=True)
class MotionLimits:
    """Limits of the speed of the arm, and of the distance of a held joint from its target.

    Units are mm/s, mm, rad/s, rad/s2, rad, s.
    """

    speed_mm_s: float
    reach_mm: float
    speed: float
    acceleration: float
    hold: float
    watchdog_s: float


@dataclass(frozen=True, slots=True)
class UrScriptMove:
    """A URScript program that moves to `goal_rad` (rad).

    Acceleration (rad/s2) and speed (rad/s) are those of the leading joint. With a number the program guards itself,
    shows its arguments in registers, and waits for its number. The call that moves has no digit in it, and takes all of
    its arguments, so that no damage can move the arm unnoticed.
    """

    goal_rad: Sequence[float]
    acceleration: float
    speed: float
    number: int | None
    watchdog_s: float

    @property
    def _named(self) -> dict[str, str]:
        return {
            "gain": f"{self.acceleration:.6f}",
            "pace": f"{self.speed:.6f}",
            "zero": "0.0",
            "guard": f"{1 / self.watchdog_s:.3f}",
        }

    @property
    def arguments(self) -> Vector:
        """The numbers that the controller must show before it may move."""
        return (*(float(f"{q:.8f}") for q in self.goal_rad), *map(float, self._named.values()))

    def text(self) -> str:
        """The text of the program."""
        goal = ", ".join(f"{q:.8f}" for q in self.goal_rad)
        if self.number is None:
            lines = [f"movej([{goal}], a={self.acceleration:.6f}, v={self.speed:.6f})"]
        else:
            given = [f"goal[{i}]" for i in range(len(self.goal_rad))] + list(self._named)
            lines = [
                f"goal = [{goal}]",
                *(f"{name} = {value}" for name, value in self._named.items()),
                f"number = {self.number}",
                f'rtde_set_watchdog("input_int_register_{REGISTER}", guard, "stop")',
                *(
                    f"write_output_float_register({i}, {name})"
                    for i, name in enumerate(given, start=FIRST_ARGUMENT)
                ),
                f"write_output_integer_register({REGISTER}, number)",
                f"while read_input_integer_register({GO_REGISTER}) != number:",
                "  sync()",
                "end",
                "movej(goal, gain, pace, zero, zero)",
            ]
        return "".join(["def truepose():\n", *(f"  {line}\n" for line in lines), "end\n"])


def not_ready(state: UrState) -> AcquisitionError | None:
    """Return the reason why no program may be sent now, or None."""
    problem = unfit(state, moving=False)
    if problem is None and not (state.runtime_state == STOPPED and state.at_rest):
        return Busy(
            "a program runs or is paused on the controller, or the arm moves",
            raw=state.shown,
            what_to_do="Stop the program on the pendant and release the arm, then confirm.",
        )
    return problem


class Motion:
    """The moves of an arm, one at a time, and `halt` from any thread.

    `port` returns the port that takes programs now. `stopped` is set by a stop or disconnect since the arming.
    """

    def __init__(
        self, port: Callable[[], ScriptPort], name: str, limits: MotionLimits, clock: Callable[[], float]
    ) -> None:
        self.stopped = threading.Event()
        self._port = port
        self._name = name
        self._limits = limits
        self._clock = clock
        self._sending = threading.Lock()
        self.goal: Vector | None = None  # of the move under way

    @property
    def _deadlines(self) -> UrDeadlines:
        return self._port().deadlines

    @contextmanager
    def at_most(self, speed: float) -> Iterator[None]:
        """Limit the leading joint to this speed, rad/s, in moves that begin within the block."""
        usual, self._limits = self._limits, replace(self._limits, speed=min(speed, self._limits.speed))
        try:
            yield
        finally:
            self._limits = usual

    def move(self, feed: Rtde | ScriptPort, goal: Vector) -> tuple[UrState, AcquisitionError | None]:
        """Make a whole move to `goal` (rad), watched on `feed`.

        Returns the final state, and the error if the move failed.
        """
        with self._under_way(goal), feed.watch("move_to", guarding=True) as witness:
            state = witness.state()
            problem = not_ready(state)
            if problem is not None:
                return state, problem
            with ExitStack() as undo:
                undo.callback(self._halt_if_possible)  # however this ends, the arm must be at rest
                problem = self._begin(feed, witness, state, goal)
                if problem is None:
                    state, problem = self._follow(witness, goal, self._move_seconds(state, goal))
                if problem is None:
                    undo.pop_all()
        return state, problem

    @contextmanager
    def _under_way(self, goal: Vector) -> Iterator[None]:
        self.goal = goal
        try:
            yield
        finally:
            self.goal = None

    def went_on(self, goal: Vector) -> bool:
        """Check whether the arm is at the target of a program; False if the state cannot be read."""
        with suppress(LinkError), self._port().watch("stop") as witness:
            return witness.state().off_rad(goal) <= self._limits.hold
        return False

    def halt(self, port: ScriptPort | None = None) -> None:
        """Send stop until the arm is at rest; a disconnect in between does not end it.

        `port` can have separate deadlines.

        Raises
        ------
        LinkError
            The arm did not come to rest in time, or the controller takes no programs.
        """
        seconds = self._deadlines.stop_s
        end = self._clock() + seconds
        with (port or self._port()).talk("stop", outlives_close=True) as (witness, send):
            next_word = -math.inf
            while self._clock() < end:
                if self._clock() >= next_word:
                    next_word = self._clock() + _LOOK_S
                    with self._sending:
                        send(STOP_SCRIPT)
                try:
                    state = witness.state()
                except WrongMode as error:
                    raise LinkError(error.message, device=self._name, command="stop") from error
                if state.at_rest and state.runtime_state in (STOPPED, PAUSED):
                    return
        raise LinkTimeout(
            f"the arm did not come to rest within stop_s = {seconds:g} s", device=self._name, command="stop"
        )

    def _halt_if_possible(self) -> None:
        with suppress(LinkError):
            self.halt()

    def _begin(
        self, feed: Rtde | ScriptPort, witness: StateConfirmer, here: UrState, goal: Vector
    ) -> AcquisitionError | None:
        """Send the program, check that it begins, and release it."""
        number = None
        if feed.numbered and here.echo is not None:
            number = here.echo % _LAST_NUMBER + 1  # a value that the register does not hold yet
        limits = self._limits
        program = UrScriptMove(goal, limits.acceleration, self._capped(here, goal), number, limits.watchdog_s)
        with self._port().talk("move_to") as (beside, send):
            with self._sending:  # a stop comes first and nothing is sent, or later and ends what was sent
                if self.stopped.is_set():
                    return MotionStopped("stopped before it began")
                send(program.text())
            problem = self._begun(witness, here, program)
            if isinstance(problem, WrongMode):
                with suppress(LinkError):
                    beside.state()  # 30001 says why, in front of its next state
            if problem is None and number is not None:
                if self.stopped.is_set():
                    return MotionStopped("stopped before it began")
                feed.release(number)
            return problem

    def _begun(
        self, witness: StateConfirmer, here: UrState, program: UrScriptMove
    ) -> AcquisitionError | None:
        """Wait until the program that was sent has begun; return the error if it does not.

        The beginning is detected from its number, otherwise from any activity of the controller.
        """
        end = self._clock() + self._deadlines.start_s
        while True:
            state = witness.state()
            problem = unfit(state, moving=True)
            if problem is not None:
                return problem
            if program.number is None:
                moved = not _same(state.target_rad, here.target_rad, 2 * AGREE_RAD)
                if state.runtime_state == PLAYING or moved:
                    return None
            elif state.echo == program.number and _same(state.arguments, program.arguments, _WRITTEN):
                return None
            elif state.echo != here.echo:
                return ProtocolError("another program arrived than was sent; nothing moved", raw=state.shown)
            if self._clock() < end:
                continue
            if self.stopped.is_set():
                return MotionStopped("stopped before it began", raw=state.shown)
            if program.number is None and state.off_rad(program.goal_rad) <= self._limits.hold:
                return None  # already there: too short a program to be seen
            return WrongMode(
                f"program did not begin within start_s = {self._deadlines.start_s:g} s",
                raw=state.shown,
                what_to_do="Switch the controller to remote control on the pendant (not on a CB3), then confirm.",
            )

    def _follow(
        self, witness: StateConfirmer, goal: Vector, seconds: float
    ) -> tuple[UrState, AcquisitionError | None]:
        """Read states until the arm is at rest at the end of its program."""
        end = self._clock() + seconds
        rest_since = math.inf
        while True:
            state = witness.state()
            problem = unfit(state, moving=True)
            if problem is not None:
                return state, problem
            now = self._clock()
            if state.runtime_state == STOPPED and state.at_rest:
                rest_since = min(rest_since, now)
                settled = state.off_rad(state.target_rad) <= self._limits.hold
                if settled or now - rest_since > self._deadlines.settle_s:
                    return state, self._judge(state, goal)
            else:
                rest_since = math.inf
                if self.stopped.is_set():
                    self.halt()  # the stop may have overtaken the move: say it again
            if now > end:
                return state, NotReached(
                    f"target not reached within move_s = {seconds:.1f} s: program paused, or speed slider low?",
                    raw=state.shown,
                )

    def _judge(self, state: UrState, goal: Vector) -> AcquisitionError | None:
        """Return the error for an arm at rest after a move to `goal`, or None if it has arrived."""
        if self.stopped.is_set():
            return MotionStopped("stopped on its way", raw=state.shown)
        off = state.off_rad(goal)
        joint = 1 + max(range(len(goal)), key=lambda i: abs(state.actual_rad[i] - goal[i]))
        text = f"joint {joint} is {math.degrees(off):.4f} deg from where it was sent"
        if not _same(state.target_rad, goal, _COMMANDED_RAD):
            return MotionStopped(
                f"program ended before its target or had another one, {text}", raw=state.shown
            )
        return None if off <= self._limits.hold else NotReached(text, raw=state.shown)

    def _capped(self, here: UrState, goal: Vector) -> float:
        """Compute the speed of the leading joint, rad/s.

        movej has no speed of the tool: the sum of all levers bounds it.
        """
        far = [abs(a - b) for a, b in zip(here.actual_rad, goal, strict=True)]
        distance_mm = self._limits.reach_mm * sum(lever * q for lever, q in zip(_LEVERS, far, strict=True))
        return min(self._limits.speed, self._limits.speed_mm_s * max(far) / max(distance_mm, 1e-9))

    def _move_seconds(self, here: UrState, goal: Vector) -> float:
        speed = self._capped(here, goal)
        predicted = here.off_rad(goal) / speed + speed / self._limits.acceleration
        return self._deadlines.move_factor * predicted + self._deadlines.move_margin_s
