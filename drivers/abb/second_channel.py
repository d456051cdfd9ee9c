"""A second channel to an ABB controller: states and joints by RWS during a run.

A separate thread asks Robot Web Services (RWS) every `rws_every_s`, and keeps the last state. The driver only reads the
state that is kept, so a slow or dead web server delays neither the RAPID channel nor its stop. Its checks:

- The emergency stop, the motors, the operating mode since the arming, and whether the RAPID program runs: during a
  move, and when the robot is armed.
- The joints of a robot that both channels see at rest: they differ by at most `AGREE_DEG`, or the next question fails.
- A channel that was silent for `rws_silent_s` allows no further move; a move under way is not ended for it.

If the RAPID channel does not answer a stop, the second one stops the RAPID program (`stop`). A program that was
stopped so continues its move when a person starts it: the program pointer has to be set to main first.
"""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable, Sequence

from drivers.abb.conversation import AbbDeadlines
from drivers.abb.rws import RwsAccess, RwsSession, RwsState
from drivers.errors import (
    AcquisitionError,
    Busy,
    ErrorPlace,
    LinkTimeout,
    ProgramNotReady,
    ProtocolError,
    WrongMode,
)
from drivers.interfaces import apart_deg
from drivers.link import WireSink

_LOG = logging.getLogger(__name__)
AGREE_DEG = 0.02  # servos that hold, and the two decimals of open_abb
_LOOKS_S = 0.2  # between two looks whether a stop has acted: two questions each, of 20 a second
_MAIN = "Set the program pointer to main before you start the program again: else it goes on with the stopped move."


class SecondChannel:
    """Robot Web Services as the second channel of one robot; any thread may call its methods.

    Parameters
    ----------
    access
        Returns address and password; called when the channel is connected.
    """

    def __init__(
        self,
        access: Callable[[], RwsAccess],
        name: str,
        deadlines: AbbDeadlines,
        *,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.deadlines = deadlines
        self.version = ""  # of RobotWare, once connected
        self._access = access
        self._device = f"{name}-rws"
        self._wire, self._clock = wire, clock
        self._changed = threading.Condition()
        self._ended = threading.Event()  # of the thread that looks now
        self._ended.set()
        self._session: RwsSession | None = None
        self._state: RwsState | None = None
        self._begun_s = 0.0  # when the questions of this state began
        self._failure: AcquisitionError | None = None  # of the last look
        self._rest: tuple[float, ...] | None = None  # where the other channel sees the robot at rest
        self._rests = 0  # changes whenever the robot comes to rest or leaves it
        self._doubt: ProtocolError | None = None
        self._mode = ""  # in which the robot was armed
        self._stopping = threading.Lock()

    # -- connection ---------------------------------------------------------------------------------------

    def connect(self, joints_deg: Sequence[float]) -> None:
        """Open a session, compare the joints with those of the other channel, and begin to look.

        Raises
        ------
        LinkError
            The connection failed, something else answers, or it is another robot.
        ConfigError
            The certificate is not pinned, the password cannot be read, or it is wrong.
        Busy
            The controller has no free session.
        """
        self.disconnect()
        session = self._new_session(self._access())
        try:
            self.version = session.version()
            state = session.state()
            self.compare(state, joints_deg)
        except BaseException:
            session.close()
            raise
        ended = threading.Event()
        with self._changed:
            self._session, self._ended = session, ended
            self._state, self._begun_s, self._failure = state, self._clock(), None
            self._rest = self._doubt = None
        threading.Thread(target=self._watch, args=(session, ended), name=self._device, daemon=True).start()

    def disconnect(self) -> None:
        """End looking; the thread closes its session. Never raises, and does not wait."""
        with self._changed:
            self._ended.set()
            self._session = self._state = self._rest = self._doubt = None
            self._changed.notify_all()  # who waits for a state gets none

    def _new_session(self, access: RwsAccess) -> RwsSession:
        return RwsSession(access, self._device, self.deadlines.rws_s, wire=self._wire, clock=self._clock)

    def _watch(self, session: RwsSession, ended: threading.Event) -> None:
        try:
            while not ended.wait(self.deadlines.rws_every_s):
                self._look(session, ended)
        finally:
            session.close()

    def _look(self, session: RwsSession, ended: threading.Event) -> None:
        rests, begun_s = self._rests, self._clock()
        session.limit_s = self.deadlines.rws_s
        try:
            state, failure = session.state(), None
        except AcquisitionError as error:
            state, failure = None, error
        with self._changed:
            if ended.is_set():
                return
            self._failure = failure
            if state is not None:
                self._state, self._begun_s = state, begun_s
                self._compare(state, rests)
            self._changed.notify_all()

    def _compare(self, state: RwsState, rests: int) -> None:
        if self._rest is not None and rests == self._rests:
            off = apart_deg(state.joints_deg, self._rest)
            if off > AGREE_DEG:
                self._doubt = self._apart(off, state)

    def _apart(self, off: float, state: RwsState) -> ProtocolError:
        shown = ", ".join(f"{q:.3f}" for q in state.joints_deg)
        return ProtocolError(
            f"the two channels read joints {off:.3f} deg apart; Robot Web Services say {shown}",
            device=self._device,
            command="position",
            raw=state.raw,
            what_to_do="Compare both with the pendant, and check that rws in the address is a port of the same robot.",
        )

    # -- looks --------------------------------------------------------------------------------------------

    def at_rest(self, joints_deg: Sequence[float] | None) -> None:
        """Note where the other channel sees the robot at rest, None if it may move from now on."""
        with self._changed:
            self._rest = None if joints_deg is None else tuple(joints_deg)
            self._rests += 1

    @property
    def doubts(self) -> bool:
        """Whether it saw a robot at rest with other joints than the other channel."""
        return self._doubt is not None

    def compare_joints(self, joints_deg: Sequence[float]) -> None:
        """Raise ProtocolError if the channels differed and the robot was not moved since.

        A robot that a person moved meanwhile is no difference.
        """
        with self._changed:
            doubt, rest = self._doubt, self._rest
            if doubt is None:
                return
            if rest is not None and apart_deg(joints_deg, rest) <= AGREE_DEG:
                raise doubt
            self._doubt = self._rest = None

    def fresh(self, command: str) -> RwsState:
        """Return a state that was asked after this call began, within `rws_silent_s`.

        Raises
        ------
        LinkError
            There is none in time.
        Busy, ConfigError, CommandRefused
            The controller refused the questions.
        """
        begin = self._clock()
        with self._changed:
            while self._state is None or self._begun_s < begin:
                left = begin + self.deadlines.rws_silent_s - self._clock()
                if self._ended.is_set() or left <= 0:
                    raise self._silence(command)
                self._changed.wait(left)
            return self._state

    def heard(self, command: str) -> RwsState:
        """Return the last state; errors are those of `fresh`, if it is older than `rws_silent_s`."""
        with self._changed:
            if self._state is None or self._clock() - self._begun_s > self.deadlines.rws_silent_s:
                raise self._silence(command)
            return self._state

    def _silence(self, command: str) -> AcquisitionError:
        if self._failure is not None:
            return self._failure
        return LinkTimeout(
            f"the second channel was silent for rws_silent_s = {self.deadlines.rws_silent_s:g} s",
            device=self._device,
            command=command,
        )

    def compare(self, state: RwsState, joints_deg: Sequence[float]) -> None:
        """Raise ProtocolError if the joints of a state differ from those of the other channel."""
        if (off := apart_deg(state.joints_deg, joints_deg)) > AGREE_DEG:
            raise self._apart(off, state)

    def armed(self, state: RwsState, joints_deg: Sequence[float]) -> None:
        """Note the operating mode in which the robot is armed, and where both channels see it.

        Raises
        ------
        ProtocolError
            The channels read different joints.
        ProgramNotReady
            The RAPID program is stopped.
        """
        self.compare(state, joints_deg)
        with self._changed:
            self._mode, self._doubt = state.mode, None
        self.compare_program(state, "arm")
        self.at_rest(joints_deg)

    def last(self) -> RwsState | None:
        """Return the last state, however old; None if there is none."""
        with self._changed:
            return self._state

    def compare_program(self, state: RwsState, command: str) -> None:
        """Check that the mode is that of the arming and that the program runs.

        Raises
        ------
        WrongMode
            The operating mode was changed.
        ProgramNotReady
            The RAPID program is stopped.
        """
        where: ErrorPlace = {"device": self._device, "command": command, "raw": state.raw}
        if self._mode and state.mode != self._mode:
            raise WrongMode(f"the controller went from mode {self._mode} to {state.mode}", **where)
        if not state.runs:
            raise ProgramNotReady("the RAPID program is stopped", **where, what_to_do=_MAIN)

    # -- stop ---------------------------------------------------------------------------------------------

    def stop(self) -> None:
        """Stop the RAPID program over a separate connection, and wait for the robot to stop.

        Raises
        ------
        LinkError
            The connection failed, or the robot is not at rest within `rws_stop_s`.
        CommandRefused
            The user may not stop programs.
        Busy
            The controller answers no more questions now.
        """
        with self._stopping:  # two at once would ask too often
            watching = self._session
            session = self._new_session(self._access() if watching is None else watching.access)
            if watching is not None:
                session.cookies = dict(watching.cookies)  # the same session, another connection
            end = self._clock() + self.deadlines.rws_stop_s
            try:
                while not self._answered(session.halt, end):
                    continue
                _LOG.warning("%s: stopped the RAPID program. %s", self._device, _MAIN)
                before: list[tuple[float, ...]] = []
                while not self._answered(lambda: self._at_rest(session, before), end):
                    continue
            finally:
                if watching is not None:
                    session.cookies = {}  # its session goes on
                session.close()

    def _answered(self, ask: Callable[[], object], end: float) -> bool:
        """Return whether a question was answered, and not with False; otherwise wait.

        The caller then puts the question again.

        Raises
        ------
        LinkTimeout
            It is too late to put it again.
        Busy
            It is too late, and the controller is busy.
        """
        busy = None
        try:
            if ask() is not False:
                return True
        except Busy as error:
            busy = error
        if self._clock() >= end:
            raise busy or LinkTimeout(
                f"the robot did not come to rest within rws_stop_s = {self.deadlines.rws_stop_s:g} s",
                device=self._device,
                command="stop",
            )
        threading.Event().wait(_LOOKS_S)
        return False

    def _at_rest(self, session: RwsSession, before: list[tuple[float, ...]]) -> bool:
        joints = session.joints()
        still = bool(before) and apart_deg(joints, before[-1]) < AGREE_DEG and not session.runs()
        before.append(joints)
        return still
