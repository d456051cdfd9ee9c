"""Remote Motion Interface of a Fanuc (option R912): nothing is loaded into the controller.

`FRC_Initialize` starts the TP program RMI_MOVE, to which every instruction is added. Instructions are numbered from 1
after it, without a gap; another number puts RMI on hold until `FRC_Reset`. The controller takes eight instructions
ahead and carries out the last one only if it ends FINE. This driver has one motion under way at most, which ends FINE.

**Stop.** A motion under way does not block the session. `FRC_Abort` is sent from any thread as soon as the command
before it is answered. This takes milliseconds, or `reply_s` if the connection is dead; then it is sent again in a new
session. A second connection is not possible, the controller has one session. How fast the arm stops is unknown.

**A motion is done** if its answer has come and the joints are read back at the target. While it lasts, five looks a
second at state and joints find a controller that gave up, and a robot that leaves the way to its target.

**After a lost connection** the controller may carry out the one motion that it has. This driver aborts it in a new
session at once, or when it connects again; `arm` of any driver aborts it, too. Before `FRC_Initialize` the state must
say that RMI does not run. RMI has no watchdog.

Joint 3 is counted from the horizontal as on the pendant; in the maker's stream interface it is J3 + J2. Nothing here
was tried on a controller. Sources besides those of `drivers.fanuc.rmi_link`:

- `fanuc_client.cpp` of the maker's driver: J3, order of commands
- airo-ugent/airo-fanuc: joints to 0.001 deg, second client, alarms
- paragraphs 2.3.1 to 2.3.7 of the manual, as cited in public notes: TPMode 0 is pendant off, RMIMotionStatus 0 means
  that RMI does not run
"""

from __future__ import annotations

import json
import re
import threading
import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, NoReturn

from drivers.errors import (
    AcquisitionError,
    CommandRefused,
    EmergencyStop,
    LinkError,
    LinkTimeout,
    MotionStopped,
    ProgramNotReady,
    ProtectiveStop,
    ProtocolError,
    WrongMode,
)
from drivers.fanuc.controller import (
    ALARMS,
    JOINTS,
    LOOK_S,
    WIDEST_DEG,
    FanucDeadlines,
    JointMove,
    alarm,
    raise_if_unfit,
)
from drivers.fanuc.rmi_link import HOLD, JOINTS_READ, STATUS, Packet, RmiLink, raw_of, refusal
from drivers.interfaces import Identity, JointReading, RobotStatus
from drivers.link import TcpLink

_POLL_S = 0.01
_FLAGS = ("ServoReady", "TPMode", "RMIMotionStatus", "SingleStepMode")
_ALARMS_READ = 5
_VIEWS = 4  # readings of the state until two agree
_BESIDE_DEG = 1.0  # a joint motion turns every joint straight from its start to its target
_RESOLUTION_DEG = 1e-3
_ACTUAL_FROM = 6  # major version that reads the encoders
_FACILITIES = {"SRVO": 11, "INTP": 12, "PRIO": 13, "MOTN": 15, "SYST": 24}
_ALARM = re.compile(rf"({'|'.join(_FACILITIES)})-(\d{{3}})")
_WEAKNESS = (
    "RMI moves on a request at once and has no checksum: a target that is damaged on its way moves the robot until one "
    f"of five looks a second finds it more than {_BESIDE_DEG:g} deg off its way; without a connection a motion is "
    "carried out to its end"
)
_COMMANDED = "; below RMI 6 the joints that are read back are the commanded ones"


@dataclass(frozen=True, slots=True)
class RmiState:
    """State of the controller in FRC_GetStatus.

    Attributes
    ----------
    running
        Whether RMI has control of the robot.
    single_step
        Whether the pendant lets programs run by single steps.
    override
        General override, %; None if the version does not report it.
    next_number
        Number of the next instruction; None if the controller does not check the numbers.
    """

    ready: bool
    pendant: bool
    running: bool
    single_step: bool
    override: int | None
    next_number: int | None
    raw: bytes = field(compare=False)


class RmiController:
    """The RMI session of a controller."""

    dialect = "rmi"
    can_stop = True

    def __init__(self, link: TcpLink, deadlines: FanucDeadlines) -> None:
        self.name = link.device
        self._clock = link.clock
        self._link = RmiLink(link, deadlines)
        self._stopping = threading.RLock()
        self._started = False  # remote motion, by this driver in this session
        self._left = False  # on request, perhaps of another thread
        self._lost = False  # a motion that was sent and whose end is unknown
        self._hold = False
        self._number = 1
        self._tag: int | None = None

    @property
    def deadlines(self) -> FanucDeadlines:
        return self._link.deadlines

    @deadlines.setter
    def deadlines(self, deadlines: FanucDeadlines) -> None:
        self._link.deadlines = deadlines

    @property
    def weakness(self) -> str:
        """The errors that RMI cannot detect; which joints it reads back depends on its version."""
        return _WEAKNESS + (_COMMANDED if 0 < self._link.version[0] < _ACTUAL_FROM else "")

    # -- session ------------------------------------------------------------------------------------------

    def open(self) -> None:
        """Enter a session and read the state; abort a motion whose end is unknown.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            Another program has the session.
        """
        self._started, self._left, self._tag = False, False, None
        self._link.open()
        try:
            self._state()
        except LinkTimeout as error:  # a second client is accepted and never answered
            error.what_to_do = (
                "Check that the address is the robot's and that no other program is connected to it by RMI; "
                "the controller frees the session of a program that hangs after an hour."
            )
            raise
        if self._lost:
            self._abort()

    def close(self) -> None:
        """Abort what moves, end the session; never raises."""
        self._left = True
        if self._started:
            with suppress(AcquisitionError):
                self._abort()
        self._started = False
        self._link.leave()

    def identity(self) -> Identity:
        """Return the identity; RMI reports neither model nor serial number."""
        self.joints()
        return Identity("Fanuc", "", "", "RMI {}.{}".format(*self._link.version), self.dialect)

    def prepare(self) -> None:
        """Abort what RMI still does, then start remote motion.

        Raises
        ------
        LinkError
            The connection failed.
        WrongMode
            The pendant is enabled, runs single steps, or the servo power is off.
        ProgramNotReady
            The controller does not start RMI_MOVE.
        """
        state = self._state()
        if state.single_step:
            raise WrongMode(
                "the pendant is in single step mode",
                device=self.name,
                command="arm",
                what_to_do="Switch single step mode off on the pendant, then confirm.",
            )
        if state.running:
            self._abort()
        if self._hold or self._link.ask("FRC_Initialize", accept=(0, HOLD))["ErrorID"]:
            self._link.ask("FRC_Reset")
            self._link.ask("FRC_Initialize")
        state = self._state()
        if not state.running:
            raise ProgramNotReady("remote motion did not start", device=self.name, command="arm")
        self._hold, self._started = False, True
        self._number = state.next_number or 1

    # -- motion -------------------------------------------------------------------------------------------

    def move(self, move: JointMove) -> None:
        """Move and wait for the answer; abort the motion on any error, if need be in a new session."""
        here = self.joints().joints_deg
        number, self._number = self._number, self._number + 1
        self._lost = True
        try:
            self._link.begin(number, move)
            self._wait(move, here)
        except LinkError:
            with self._stopping:
                if not self._left:
                    with suppress(AcquisitionError):
                        self.halt()
                    self._link.leave()
            raise
        except BaseException:
            with suppress(AcquisitionError):
                self._abort()
            raise
        self._lost = False

    def _wait(self, move: JointMove, here: Sequence[float]) -> None:
        begun = self._clock()
        look_at, slowest = begun + LOOK_S, self._state().override or 100
        while (answer := self._link.heard()) is None:
            if self._link.faulted:
                self._raise_fault()
            if move.stopped.is_set():
                raise MotionStopped("stopped by a client", device=self.name, command="move_to")
            now = self._clock()
            if now >= look_at:
                slowest = min(slowest, self._look(move, here))
                look_at = self._clock() + LOOK_S
            # The general override slows the motion down; it may be changed on the pendant at any time.
            if now >= begun + move.seconds * 100.0 / max(slowest, 1):
                raise LinkTimeout(
                    f"no end of the move within move_s = {move.seconds:g} s at override {slowest} %",
                    device=self.name,
                    command="move_to",
                )
            move.stopped.wait(_POLL_S)
        error = answer["ErrorID"]
        if error:
            self._hold = True  # an instruction that is refused is followed by a hold
            raise refusal(error, self.name, "move_to", raw_of(answer))

    def _look(self, move: JointMove, here: Sequence[float]) -> int:
        """Check state and joints of a robot under way; return the override, %.

        Raises
        ------
        SafetyStop, WrongMode
            The controller gave up, or the robot is not on the way to its target.
        """
        state = self._state()
        raise_if_unfit(self._status(state), self.name, "move_to")
        off = _off(self._joints().joints_deg, here, move.target)
        if off > _BESIDE_DEG:  # a second reading excludes a damaged digit
            off = min(off, _off(self._joints().joints_deg, here, move.target))
        if off > _BESIDE_DEG:
            raise ProtectiveStop(
                f"the robot is {off:.1f} deg off the way to its target, which was damaged before it arrived",
                device=self.name,
                command="move_to",
            )
        return state.override or 100

    def _raise_fault(self) -> NoReturn:
        """Raise what the controller reports after FRC_SystemFault."""
        status = self._status(self._state(), alarmed=True)
        raise_if_unfit(status, self.name, "move_to")
        raise ProtectiveStop(
            "the motion ended in a fault (FRC_SystemFault)", device=self.name, command="move_to"
        )

    def halt(self) -> None:
        """Abort the motion.

        Raises
        ------
        LinkError
            The stop was not answered, also not in a new session.
        """
        with self._stopping:
            try:
                self._abort()
            except LinkError:  # a stop is worth a second try on a fresh connection
                self._link.open()
                self._abort()

    def _abort(self) -> None:
        """Send FRC_Abort if RMI runs or may run, and wait for its answer."""
        with self._stopping:
            if not self._started and not self._state().running:
                self._lost = False
                return
            try:
                self._link.ask("FRC_Abort", deadline="abort_s")
            except CommandRefused:  # RMIT-014 where nothing runs any more
                if self._state().running:
                    raise
            self._started = self._lost = False

    # -- readings -----------------------------------------------------------------------------------------

    def joints(self) -> JointReading:
        """Return a new reading of the joints; the controller may renew them only every 0.1 s."""
        end = self._clock() + self.deadlines.reply_s
        before = self._tag
        while True:
            reading = self._joints()
            if self._tag != before:
                return reading
            if self._clock() >= end:
                self._link.close()
                raise ProtocolError(
                    "the controller does not renew its joint angles",
                    device=self.name,
                    command="position",
                    raw=reading.raw,
                )
            time.sleep(min(_POLL_S, self.deadlines.gap_s))

    def _joints(self) -> JointReading:
        packet = self._link.ask(JOINTS_READ)
        angles = packet.get("JointAngle")
        if not isinstance(angles, dict):
            self._refuse("has no JointAngle", packet)
        joints = tuple(self._link.real(angles, f"J{i}", "position") for i in range(1, JOINTS + 1))
        if not all(abs(q) < WIDEST_DEG for q in joints):
            self._refuse("has a joint angle out of range", packet)
        self._tag = self._link.whole(packet, "TimeTag", "position")
        return JointReading(joints, _RESOLUTION_DEG, raw_of(packet))

    def _refuse(self, why: str, packet: Packet) -> NoReturn:
        self._link.close()
        raise ProtocolError(f"a packet {why}", device=self.name, command="position", raw=raw_of(packet))

    def status(self) -> RobotStatus:
        return self._status(self._state())

    def _status(self, state: RmiState, *, alarmed: bool = False) -> RobotStatus:
        """Return the status; a controller that is not ready, or `alarmed`, must report its alarm.

        The servo power is unknown if an alarm explains why the controller is not ready.
        """
        number = self._alarm() if alarmed or not state.ready else None
        stopped: bool | None = False
        if number is not None:
            stopped = alarm(*divmod(number, 1000))[0] is EmergencyStop
        elif not state.ready:
            stopped = None
        power = True if state.ready else None if number is not None else False
        return RobotStatus("manual" if state.pendant else "auto", power, stopped, None, number, state.raw)

    def _state(self) -> RmiState:
        """Return the state from two equal answers in a row, to exclude a damaged digit.

        Raises
        ------
        LinkError
            The connection failed, or the answers do not agree.
        """
        before = self._read_state()
        for _ in range(_VIEWS):
            now = self._read_state()
            if now == before:
                return now
            before = now
        self._link.close()
        raise ProtocolError("the state changes in every answer", device=self.name, command=STATUS)

    def _read_state(self) -> RmiState:
        packet = self._link.ask(STATUS)
        flags = (self._link.whole(packet, key, STATUS) for key in _FLAGS)
        override, number = (
            self._link.whole(packet, key, STATUS) if key in packet else None
            for key in ("Override", "NextSequenceID")
        )
        ready, pendant, running, single_step = (flag != 0 for flag in flags)
        return RmiState(ready, pendant, running, single_step, override, number, raw_of(packet))

    def _alarm(self) -> int | None:
        """Return 1000 x facility + number of the alarm that matters most, None if none is reported."""
        count: dict[str, Any] = {"Count": _ALARMS_READ} if self._link.version[0] >= _ACTUAL_FROM else {}
        packet = self._link.ask("FRC_ReadError", **count)
        texts = " ".join(str(text) for key, text in packet.items() if key.startswith("ErrorData"))
        found = [(_FACILITIES[name], int(number)) for name, number in _ALARM.findall(texts)]
        known = [each for each in found if each in ALARMS]
        facility, number = next(iter(known or found), (0, 0))
        return 1000 * facility + number or None


def _off(joints: Sequence[float], start: Sequence[float], target: Sequence[float]) -> float:
    """Return how far a joint is beyond its start or its target, deg."""
    return max(max(min(a, b) - q, q - max(a, b)) for q, a, b in zip(joints, start, target, strict=True))


def override_of(status: RobotStatus) -> float | None:
    """Return the general override in a status of RMI, as a share; None if it has none."""
    override = json.loads(status.raw).get("Override")
    return override / 100.0 if isinstance(override, int) else None
