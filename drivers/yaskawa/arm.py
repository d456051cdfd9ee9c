"""Yaskawa arms of six axes on DX100, DX200 or YRC1000, by the High-Speed Ethernet Server.

    udp://192.168.1.31:10040

The controller counts pulses; `pulses_per_deg` of the cell file converts them. A move runs in the job `TRUEPOSE1` of
the robot side. The driver writes target, speed, number and a checksum into variables. It then selects the job from its
first line, so that a held motion is not resumed, and starts it once. The job takes a number only once and refuses a
target that does not fit the checksum. Thus no repeated, late or damaged datagram moves the robot a second time or
elsewhere.

A move has ended if three things agree. The job reports its number as done, the controller reports no running job, and
two readings of the position agree with each other and with the target. Everything is read twice, because the protocol
has no checksum. `stop` is a hold (command 0x83) from its own port of this computer, which waits for no other answer.

Nothing here was tried on a controller yet.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import TypeVar

from drivers.errors import (
    AcquisitionError,
    Busy,
    ConfigError,
    EnableLost,
    ErrorPlace,
    LinkTimeout,
    MotionStopped,
    NotArmed,
    NotReached,
    ProgramNotReady,
    ProtectiveStop,
    ProtocolError,
    WrongMode,
)
from drivers.interfaces import Identity, JointReading, RobotStatus, apart_deg, is_there
from drivers.limits import Caps
from drivers.link import WireSink, parse_url
from drivers.yaskawa import hses
from drivers.yaskawa.hses import JOB, JOINTS, HsesLink, YaskawaDeadlines

_LOG = logging.getLogger(__name__)
_WIDEST_DEG = 1000.0
_AGREE_PULSES = 2  # two readings of a robot at rest
_VIEWS = 10  # until two readings in a row are equal
_POLL_S = 0.02
_LAST_NUMBER = 9_999_999
_FULL_SPEED = 10_000  # VJ in 0.01 %
_FIRST_LINES = 1  # NOP is line 0; a comment follows
_DONE, _OTHER_TARGET = 2, 3  # last digit of the echo of the job; 1: it moves
_T = TypeVar("_T")


@dataclass(frozen=True, slots=True)
class ControllerState:
    """The two words of the status (command 0x72) and the newest alarm."""

    modes: int
    flags: int
    alarm: int = 0
    text: str = ""

    @property
    def running(self) -> bool:
        return bool(self.modes & 0x08)

    @property
    def teaching(self) -> bool:
        return bool(self.modes & 0x20)

    @property
    def remote(self) -> bool:
        return bool(self.modes & 0x80)

    @property
    def held(self) -> str:
        """Name of the pendant or signal that holds the robot; empty if it is not held."""
        return "the pendant" if self.flags & 0x02 else "an external signal" if self.flags & 0x04 else ""

    @property
    def held_by_command(self) -> bool:
        return bool(self.flags & 0x08)

    @property
    def alarmed(self) -> bool:
        return bool(self.flags & 0x30)

    @property
    def servo_on(self) -> bool:
        return bool(self.flags & 0x40)

    def trouble(self, device: str, command: str) -> AcquisitionError | None:
        """Return the error that prevents a move, or that ended it; None if there is none."""
        where: ErrorPlace = {"device": device, "command": command}
        moved = command == "move_to"
        if self.alarmed:
            text = f"alarm {self.alarm}: {self.text}" if self.alarm else "an error is shown on the pendant"
            return ProtectiveStop(text, **where)
        if self.teaching:
            return WrongMode("teach mode", what_to_do=_TO_REMOTE, **where)
        if not self.servo_on:
            return (
                EnableLost("servo power went off", **where)
                if moved
                else WrongMode("servo power off", **where)
            )
        if self.held:
            kind = MotionStopped if moved else ProgramNotReady
            return kind(f"held by {self.held}", what_to_do="Release the hold, then confirm.", **where)
        if not self.remote and not moved:  # a move under way is completed
            return WrongMode("command remote is off", what_to_do=_TO_REMOTE, **where)
        return None


_TO_REMOTE = "Turn the mode switch to REMOTE, allow command remote and switch the servos on, then confirm."


class YaskawaArm:
    """The driver of a Yaskawa robot of six axes.

    Methods block; `stop` and `status` answer while another thread waits for a move.

    Parameters
    ----------
    pulses_per_deg
        Pulses that the controller counts per degree of each joint.
    max_deg_s
        Speed of each joint at VJ = 100 %, deg/s.
    hold_deg
        Largest distance from its target at which a servo may hold a joint (`drivers.interfaces`).
    """

    unverified_on_hardware = True
    can_stop = True

    def __init__(
        self,
        url: str,
        *,
        pulses_per_deg: Sequence[float],
        max_deg_s: Sequence[float],
        name: str = "yaskawa",
        speed_mm_s: float = 500.0,
        speed_deg_s: float = 20.0,
        limits_deg: Sequence[Sequence[float]] | None = None,
        hold_deg: float = 0.003,
        deadlines: YaskawaDeadlines | None = None,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self._caps = Caps(
            speed_mm_s, speed_deg_s, limits_deg, joints=JOINTS, widest_deg=_WIDEST_DEG, device=name
        )
        self._per_deg = _positive("pulses_per_deg", pulses_per_deg, name)
        self._max_deg_s = _positive("max_deg_s", max_deg_s, name)
        address = parse_url(url, scheme="udp")
        self.name = name
        self._hold_deg = hold_deg
        self._clock = clock
        self._link = HsesLink(address, name, deadlines or YaskawaDeadlines(), clock, wire)
        self._stop_link = HsesLink(address, name, self._link.deadlines, clock, wire)
        self._stop_lock = threading.Lock()
        self._lock = threading.RLock()
        self._armed = False
        self._under_way = False
        self._stopped = threading.Event()
        self._number = 0
        self._warned = False

    @property
    def deadlines(self) -> YaskawaDeadlines:
        """The named waits; may be replaced between questions."""
        return self._link.deadlines

    @deadlines.setter
    def deadlines(self, deadlines: YaskawaDeadlines) -> None:
        self._link.deadlines = self._stop_link.deadlines = deadlines

    # -- connection ---------------------------------------------------------------------------------------

    def connect(self) -> None:
        """Take a port and read status and joints. Nothing moves.

        Raises
        ------
        LinkError
            There is no answer, or one of another protocol.
        Busy
            The robot is moving.
        """
        if not self._warned:
            _LOG.warning(
                "%s: this Yaskawa driver is unverified on hardware; if the network fails during a move, nothing stops "
                "the robot before its target",
                self.name,
            )
        self._warned = True
        with self._lock:
            self.disconnect()
            try:
                self._link.open()
                self._state()
                self.position()
            except BaseException:
                self.disconnect()
                raise

    def disconnect(self) -> None:
        """Close, disarm, and hold a move that is under way; never raises."""
        self._armed = False
        self._link.close()
        if self._under_way:
            self._halt_quietly()

    def identify(self) -> Identity:
        """Return model and software of the controller; HSES reports no serial number.

        Raises
        ------
        LinkError
            The connection failed.
        """
        data = self._twice(lambda: self._link.ask(hses.IDENTITY))
        return Identity("Yaskawa", _text(data[24:40]), "", _text(data[:24]), "hses")

    def status(self) -> RobotStatus:
        """Return the state of the controller; HSES does not report the emergency stop.

        Raises
        ------
        LinkError
            The connection failed.
        """
        state = self._state()
        mode = "manual" if state.teaching else "auto"
        return RobotStatus(mode, state.servo_on, None, state.running, state.alarm or None)

    def trouble(self) -> AcquisitionError | None:
        """Return why the robot could not move now, for `truepose doctor`; may raise LinkError."""
        return self._state().trouble(self.name, "status")

    # -- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Check the controller, void the last target, release our hold; allow motion.

        Raises
        ------
        LinkError
            The connection failed.
        SafetyStop
            An alarm is shown.
        WrongMode
            Teach mode, servo power off, or command remote off.
        ProgramNotReady
            The job is not loaded, or the robot is held.
        Busy
            A job runs.
        MotionStopped
            `stop` was called meanwhile.
        """
        with self._lock:
            state = self._state()
            trouble = state.trouble(self.name, "arm")
            if trouble is not None:
                raise trouble
            if state.running:
                raise Busy("a job is running", device=self.name, command="arm")
            self._stopped.clear()
            # A start that is still on its way must find nothing to do.
            self._write(hses.SUM, -1)
            if state.held_by_command:
                self._link.ask(hses.RELEASE)
            self._link.ask(hses.ONE_CYCLE)  # in AUTO the job would begin again by itself
            self._link.ask(hses.SELECT)
            self._number = self._read(hses.TAKEN)
            state = self._state()
            if state.modes & 0x05 or not state.modes & 0x02 or state.held_by_command:
                raise ProgramNotReady(
                    "the controller is not in 1 CYCLE, or held by a command", device=self.name, command="arm"
                )
            self._armed = True
            if self._stopped.is_set():
                self._armed = False
                raise MotionStopped("stopped meanwhile", device=self.name, command="arm")

    def disarm(self) -> None:
        """Allow no more motion until armed again; never raises."""
        self._armed = False

    # -- motion -------------------------------------------------------------------------------------------

    def move_to(self, joints_deg: Sequence[float]) -> JointReading:
        """Move to these joint angles, wait until the robot is there, read back.

        Raises
        ------
        NotArmed, JointLimit
            Nothing moves.
        LinkError
            The connection failed, and the position of the robot is unknown.
        SafetyStop, WrongMode, MotionStopped, ProgramNotReady
            The robot was stopped on its way.
        NotReached
            The robot is not at its target.
        Busy
            Another client commands the robot.
        """
        target = tuple(float(q) for q in joints_deg)
        self._caps.check(target)
        with self._lock:
            if not self._armed:
                raise NotArmed("motion without arming", device=self.name, command="move_to")
            try:
                pulses = tuple(round(q * per) for q, per in zip(target, self._per_deg, strict=True))
                speed, seconds = self._pace(target)
                self._order(pulses, speed)
                self._follow(self._clock() + seconds)
                return self._settled(target)
            except BaseException:
                self._armed = False  # wherever the robot is now, a person has to check first
                if self._under_way:
                    self._halt_quietly()
                raise

    def position(self) -> JointReading:
        """Return the joint angles from two readings, `gap_s` apart, that agree.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            The robot is still moving.
        """
        end = self._clock() + self.deadlines.settle_s
        with self._lock:
            before = self._pulses()
            while True:
                time.sleep(self.deadlines.gap_s)
                now = self._pulses()
                if apart_deg(before, now) <= _AGREE_PULSES:
                    return self._reading(now)
                if self._clock() >= end:
                    raise Busy("the robot is still moving", device=self.name, command="position")
                before = now

    def stop(self) -> None:
        """Hold the robot now and disarm. From any thread, and also without a connection.

        Raises
        ------
        LinkError
            The hold was not answered.
        WrongMode
            The controller refuses it, because command remote is off.
        """
        self._armed = False
        self._stopped.set()
        self._halt()

    def _order(self, pulses: Sequence[int], speed: int) -> None:
        """Write the target, select the job from its beginning and start it once."""
        self._number = self._number % _LAST_NUMBER + 1
        self._link.ask(hses.target_of(pulses))
        self._write(hses.SPEED, speed)
        self._write(hses.SUM, hses.sum_of(self._number, speed, pulses))
        self._write(hses.NUMBER, self._number)
        self._link.ask(hses.SELECT)
        # Selected from a later line, by a damaged request, it would move without its checks.
        job = self._twice(lambda: self._link.ask(hses.SELECTED))
        if _text(job[:32]) != JOB or int.from_bytes(job[32:36], "little") > _FIRST_LINES:
            raise ProtocolError(
                f"job {JOB} is not selected from its first line", device=self.name, command="move_to"
            )
        if self._stopped.is_set():
            raise MotionStopped("asked to stop", device=self.name, command="move_to")
        self._under_way = True
        self._link.ask_once(hses.START)  # never again: without an answer, the echo of the job tells

    def _follow(self, end_s: float) -> None:
        """Wait until the job has ended at this number."""
        begun = self._clock() + self.deadlines.start_s
        while True:
            words, echo = self._twice(
                lambda: (_words(self._link), self._link.ask(hses.reading_of(hses.ECHO)))
            )
            state = ControllerState(*words)
            number, code = divmod(int.from_bytes(echo, "little", signed=True), 10)
            ours = number == self._number
            if not state.running and ours and code == _DONE:
                self._under_way = False
                return
            if self._stopped.is_set():
                if not state.running:
                    raise MotionStopped("stopped, or asked to stop", device=self.name, command="move_to")
                self._halt()  # the start may have overtaken the hold
            if ours and code == _OTHER_TARGET:
                self._under_way = False
                raise ProtocolError(
                    "the target that arrived there is not the one that was sent; nothing moved",
                    device=self.name,
                    command="move_to",
                )
            self._raise_trouble(state)
            if self._clock() >= (end_s if ours or state.running else begun):
                raise LinkTimeout(
                    f"job {JOB} has not ended in time" if ours else f"job {JOB} has not taken the target",
                    device=self.name,
                    command="move_to",
                )
            if ours and not state.running and self._clock() >= begun:
                raise ProgramNotReady(f"job {JOB} ended on its way", device=self.name, command="move_to")
            time.sleep(_POLL_S)

    def _raise_trouble(self, state: ControllerState) -> None:
        if state.alarmed:
            state = self._state()
        if (trouble := state.trouble(self.name, "move_to")) is not None:
            raise trouble
        if state.held_by_command and not self._stopped.is_set():
            raise MotionStopped("held by a command of another program", device=self.name, command="move_to")

    def _settled(self, target: tuple[float, ...]) -> JointReading:
        """Wait until the robot is at the target and return its reading."""
        end = self._clock() + self.deadlines.settle_s
        before = self._pulses()
        while True:
            if self._stopped.wait(self.deadlines.gap_s):
                raise MotionStopped("stopped, or asked to stop", device=self.name, command="move_to")
            now = self._pulses()
            reading = self._reading(now)
            if is_there(reading, target, self._hold_deg) and apart_deg(before, now) <= _AGREE_PULSES:
                return reading
            if self._clock() >= end:
                raise NotReached(
                    f"{apart_deg(reading.joints_deg, target):.3f} deg from where it was sent, "
                    f"settle_s = {self.deadlines.settle_s:g} s after the reported end",
                    device=self.name,
                    command="move_to",
                )
            before = now

    def _halt(self) -> None:
        """Hold the robot, over a separate port, so that no pending question delays it.

        The hold is read back, and ordered again if it did not take effect.
        """
        with self._stop_lock:
            self._stop_link.open()
            try:
                for _ in range(self.deadlines.tries):
                    self._stop_link.ask(hses.HOLD)
                    if ControllerState(*_words(self._stop_link)).held_by_command:
                        return
            finally:
                self._stop_link.close()
        raise LinkTimeout("the hold was answered but is not in effect", device=self.name, command="stop")

    def _halt_quietly(self) -> None:
        self._under_way = False
        with suppress(AcquisitionError):
            self._halt()

    def _pace(self, target: Sequence[float]) -> tuple[int, float]:
        """Choose the speed (0.01 %, at least 1) and the longest time of a move (s).

        The speed is within both speed limits.
        """
        here = self._reading(self._twice(self._pulses)).joints_deg
        far = [abs(a - b) for a, b in zip(target, here, strict=True)]
        wanted_s = self._caps.seconds(far)
        full_s = max(dq / top for dq, top in zip(far, self._max_deg_s, strict=True))
        share = full_s / wanted_s if wanted_s > 0 else 0.0
        speed = max(1, min(_FULL_SPEED, math.floor(_FULL_SPEED * share)))
        return speed, self.deadlines.move_factor * _FULL_SPEED * full_s / speed + self.deadlines.move_margin_s

    # -- reading ------------------------------------------------------------------------------------------

    def _twice(self, ask: Callable[[], _T]) -> _T:
        """Return what two readings in a row agree on.

        Raises
        ------
        ProtocolError
            No two readings agree.
        """
        before = ask()
        for _ in range(_VIEWS):
            now = ask()
            if now == before:
                return now
            before = now
        self._link.close()
        raise ProtocolError("every answer is another one", device=self.name, command="status")

    def _state(self) -> ControllerState:
        state = ControllerState(*self._twice(lambda: _words(self._link)))
        if not state.flags & 0x10:
            return state
        data = self._twice(lambda: self._link.ask(hses.ALARM))
        return replace(state, alarm=int.from_bytes(data[:4], "little"), text=_text(data[28:60]))

    def _pulses(self) -> tuple[int, ...]:
        return hses.pulses_in(self._link.ask(hses.PULSES), self.name)

    def _reading(self, pulses: Sequence[int]) -> JointReading:
        """Return the joint angles of pulses; the coarsest joint decides on the resolution."""
        angles = tuple(count / per for count, per in zip(pulses, self._per_deg, strict=True))
        return JointReading(angles, 1.0 / min(self._per_deg))

    def _read(self, variable: int) -> int:
        data = self._twice(lambda: self._link.ask(hses.reading_of(variable)))
        return int.from_bytes(data, "little", signed=True)

    def _write(self, variable: int, value: int) -> None:
        self._link.ask(hses.writing_of(variable, value))


def _words(link: HsesLink) -> tuple[int, int]:
    """Return the two words of the status."""
    data = link.ask(hses.STATUS)
    return int.from_bytes(data[:4], "little"), int.from_bytes(data[4:], "little")


def _text(data: bytes) -> str:
    return data.split(b"\0", 1)[0].decode("latin-1").strip()


def _positive(key: str, values: Sequence[float], device: str) -> tuple[float, ...]:
    """Return one positive number per joint.

    Raises
    ------
    ConfigError
        They are not.
    """
    if len(values) != JOINTS or not all(0 < value < math.inf for value in values):
        raise ConfigError(
            f"{key} = {list(values)} is not {JOINTS} positive numbers",
            device=device,
            what_to_do="Give one number per joint in the cell file.",
        )
    return tuple(values)
