"""ABB IRC5 and OmniCore over RAPID sockets: the open_abb dialect, and our superset of it.

open_abb (robotics/open_abb `RAPID/SERVER.mod`, TCP 5000): request `<code> <p1> ... <pn> #`, reply
`<code> <ok> <data>` without terminator. It answers a move after the move, reads joints back to 0.01 deg, and cannot be
stopped: `can_stop` is False. Its answers carry no number, so every question is followed by a ping. A late or doubled
answer left on the wire then meets the wrong code and closes the link. A damaged target moves the robot, and only the
read-back shows it, as `weakness` states.

`robot_side/CALSRV.mod` is our own program, detected by asking 200 (`drivers.abb.calsrv`). Its replies end with ` #` LF,
echo a sequence number and give five decimals. A target is shown back before it moves the robot. A second task on the
next port (5001) answers while the robot moves or is in an emergency stop, and stops it.

On an OmniCore controller, Robot Web Services can be a second channel (`drivers.abb.second_channel`), with its port in
the address: `tcp://192.168.125.1:5000?rws=443`. Neither dialect nor the second channel has been tried on a controller
yet.
"""

from __future__ import annotations

import logging
import math
import re
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from drivers.abb.calsrv import CalSrv
from drivers.abb.conversation import DECIMALS, AbbConversation, AbbDeadlines
from drivers.abb.rws import FACTORY_USER, RwsAccess, password_in, pinned
from drivers.abb.second_channel import SecondChannel
from drivers.errors import (
    AcquisitionError,
    CannotStop,
    ConfigError,
    LinkError,
    LinkTimeout,
    MotionStopped,
    NotArmed,
    NotReached,
    ProtectiveStop,
    ProtocolError,
)
from drivers.interfaces import Identity, JointReading, RobotStatus, apart_deg, is_there
from drivers.limits import Caps
from drivers.link import Address, TcpLink, WireSink, beside, parse_url

_LOG = logging.getLogger(__name__)
_JOINTS = 6
_STOCK_DECIMALS = 2
_WIDEST_DEG = 1000.0  # no joint of any ABB arm turns further; beyond it the answer is damaged
_IDENTITY = re.compile(rb"98 (?:0 |1 ([^*#]+)\*([^*#]+)\*([^*#]+))")
_MOST_LOOKS = 3  # beyond the first
_REDUCED_MM_S = 250.0  # the limit of a controller for the tool in manual mode at reduced speed (ISO 10218)
# It is not documented whether RAPID's NumToStr writes zeros at the end. Without them the last joint has no clear end.
_STOCK_JOINT = rb"-?\d{1,3}(?:\.\d{0,2})?"
_STOCK_JOINTS = re.compile(rb"4 (?:0 |1 (" + rb" ".join([_STOCK_JOINT] * _JOINTS) + rb"))")
_ENDED_JOINTS = re.compile(rb"4 (?:0 |1 .*\.\d{2})")
_WEAKNESS = (
    "open_abb moves on a request at once and has no checksum: a target that is damaged on its way moves the robot "
    f"there, and is seen only afterwards, from {10.0**-_STOCK_DECIMALS:g} deg on"
)


class AbbArm:
    """The driver of an ABB robot.

    Methods block; `stop` and `status` use the background connection if there is one.

    Parameters
    ----------
    hold_deg
        Largest distance from its target at which a servo may hold a joint (`drivers.interfaces`).
    rws_fingerprint, rws_user, rws_password_file
        Access to the second channel: SHA-256 of the controller's certificate, user, and a private file with the
        password. User and password are by default those of the factory. An address with its own `fingerprint`, that
        of a simulator, gets no password.
    """

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "abb",
        speed_mm_s: float = 500.0,
        speed_deg_s: float = 20.0,
        limits_deg: Sequence[Sequence[float]] | None = None,
        hold_deg: float = 0.002,
        watchdog_s: float = 2.0,
        rws_fingerprint: str = "",
        rws_user: str = "",
        rws_password_file: str = "",
        deadlines: AbbDeadlines | None = None,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        caps = Caps(speed_mm_s, speed_deg_s, limits_deg, joints=_JOINTS, widest_deg=_WIDEST_DEG, device=name)
        address = parse_url(url)
        self.name = name
        self._deadlines = deadlines or AbbDeadlines()
        self._caps = caps
        self._speeds: Sequence[float] = caps.speeds  # of moves since the arming
        self._hold_deg = hold_deg
        self._watchdog_ms = round(watchdog_s * 1000)
        behind = beside(address, "background", address.port + 1, name)
        self._main = AbbConversation(TcpLink(address, name, wire=wire, clock=clock), self._deadlines)
        self._back = AbbConversation(
            TcpLink(behind, f"{name}-background", wire=wire, clock=clock), self._deadlines
        )
        self._calsrv = CalSrv(self._main, self._back, name)
        self.second: SecondChannel | None = None
        if access := _access_to(address, name, rws_fingerprint, rws_user, rws_password_file):
            self.second = SecondChannel(access, name, self._deadlines, wire=wire, clock=clock)
        self._superset = False
        self._armed = False
        self._stopped = threading.Event()
        self._where: tuple[float, ...] | None = None
        self._clock = clock
        self._next_look = 0.0
        self._warned = False

    @property
    def deadlines(self) -> AbbDeadlines:
        """The named waits; may be replaced between questions."""
        return self._deadlines

    @deadlines.setter
    def deadlines(self, deadlines: AbbDeadlines) -> None:
        self._deadlines = self._main.deadlines = self._back.deadlines = deadlines
        if self.second is not None:
            self.second.deadlines = deadlines

    # -- connection ---------------------------------------------------------------------------------------

    @property
    def can_stop(self) -> bool:
        """True with CALSRV or a second channel; a stock open_abb itself cannot be stopped."""
        return self._superset or self.second is not None

    @property
    def weakness(self) -> str:
        """The errors that this dialect cannot detect; empty for CALSRV. Valid once connected."""
        return "" if self._superset else _WEAKNESS

    @property
    def dialect(self) -> str:
        """`calsrv` or `open_abb`, as found by the last connect."""
        return "calsrv" if self._superset else "open_abb"

    def connect(self) -> None:
        """Open, ping, probe for CALSRV, read the joints, open the second channel. Nothing moves.

        Raises
        ------
        LinkError
            A connection failed, an answer is not that of a known program, or the channels read different joints.
        ConfigError, Busy
            The second channel refuses.
        """
        first, self._warned = not self._warned, True
        if first:
            _LOG.warning("%s: this ABB driver is unverified on hardware", self.name)
        with self._main.lock:
            self.disconnect()
            try:
                self._open_main()
                self._superset = self._main.probe()
                if self._superset:
                    with self._back.lock:
                        self._back.link.open(connect_s=self.deadlines.connect_s)
                        if not self._back.probe():
                            raise ProtocolError(
                                "CALBACK does not run on the background port", device=self.name
                            )
                self._where = self.position().joints_deg
                if self.second is not None:
                    self.second.connect(self._where)
            except BaseException:
                self.disconnect()
                raise
        if first and self.weakness:
            _LOG.warning("%s: %s", self.name, self.weakness)

    def disconnect(self) -> None:
        """Close all connections and disarm; never raises."""
        self._armed = False
        self._where = None
        self._main.link.close()
        self._back.link.close()
        if self.second is not None:
            self.second.disconnect()

    def _open_main(self) -> None:
        try:
            self._main.link.open(connect_s=self.deadlines.connect_s)
            self._main.ping()
        except LinkError:
            self._main.link.open(connect_s=self.deadlines.connect_s)
            try:
                self._main.ping(again=True)
            except LinkTimeout as error:
                self._look_behind_silence()
                error.what_to_do = (
                    "Check that the RAPID program runs, which an emergency stop ends, and that no other program is "
                    "connected to the robot."
                )
                raise

    def _look_behind_silence(self) -> None:
        """Ask the background task, if any, for an emergency stop when T_ROB1 does not answer."""
        with self._back.lock, suppress(LinkError):
            self._back.link.open(connect_s=self.deadlines.ping_s)
            if self._back.probe():
                self._calsrv.raise_if_unfit(self._calsrv.status(), "connect")

    def identify(self) -> Identity:
        """Return serial number, RobotWare and type.

        They are read until two answers agree, as for positions, because a record refuses another robot by its serial
        number.

        Raises
        ------
        LinkError
            The connection failed.
        CommandRefused
            The controller refused the question.
        """
        found = self._asked_who()
        for _ in range(_MOST_LOOKS):
            before, found = found, self._asked_who()
            if found == before:
                break
        else:
            raise self._damaged("no two answers say the same robot", "identify", b"*".join(found))
        serial, firmware, model = (part.decode("latin-1").strip() for part in found)
        return Identity("ABB", model, serial, firmware, self.dialect)

    def _asked_who(self) -> tuple[bytes, ...]:
        return self._main.ask(98, (), _IDENTITY, quiet_s=self.deadlines.quiet_s).groups()

    # -- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Check the controller, set speed, stop points and watchdog; allow motion.

        Raises
        ------
        LinkError
            The connection failed.
        SafetyStop
            The emergency stop is pressed.
        WrongMode
            The controller is not in automatic mode, or its motors are off.
        ProgramNotReady
            The second channel sees that the RAPID program is stopped.
        """
        with self._main.lock:
            seen = None if self.second is None else self.second.fresh("arm")
            if seen is not None:
                self._calsrv.raise_if_unfit(seen.status, "arm")
            if self._superset:
                status = self.status()
                self._calsrv.raise_if_unfit(status, "arm")
                fastest = _REDUCED_MM_S if status.mode == "reduced" else math.inf
                slower = min(1.0, fastest / self._caps.speeds[0])
                self._speeds = tuple(slower * speed for speed in self._caps.speeds)
                self._calsrv.set_conditions(self._watchdog_ms, self._speeds)
            else:
                self._main.ask(8, self._caps.speeds)
                self._main.ask(9, (1, 0, 0, 0))  # every move ends in a stop point
            self._where = self.position().joints_deg
            if self.second is not None and seen is not None:
                self.second.armed(seen, self._where)
            self._stopped.clear()
            self._armed = True

    def disarm(self) -> None:
        """Allow no more motion until armed again; never raises."""
        self._armed = False

    # -- motion -------------------------------------------------------------------------------------------

    def move_to(self, joints_deg: Sequence[float]) -> JointReading:
        """Move to these joint angles, wait until the robot is at rest, read back.

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
        """
        target = tuple(float(q) for q in joints_deg)
        self._caps.check(target)
        with self._main.lock:
            if not self._armed:
                raise NotArmed("motion without arming", device=self.name, command="move_to")
            if self.second is not None:
                self._expect_both(self.second)
            seconds = self._move_seconds(target)
            self._next_look = self._clock() + 2 * self._main.link.poll_s
            try:
                if self._superset:
                    proof = self._calsrv.show(target)
                    if self._stopped.is_set():
                        raise MotionStopped("stopped before it began", device=self.name, command="move_to")
                    self._calsrv.go(proof, seconds, self._look)
                else:
                    self._stock_move(target, seconds)
                reached = self._settled(target)
            except BaseException:
                self._armed = False  # wherever the robot is now, a person has to check first
                raise
            self._where = reached.joints_deg
            if self.second is not None:
                self.second.at_rest(self._where)
        return reached

    def _expect_both(self, second: SecondChannel) -> None:
        """Check before a move that the second channel agrees; it expects a move from now on."""
        try:
            seen = second.heard("move_to")
            self._calsrv.raise_if_unfit(seen.status, "arm")  # as then: nothing moves yet
            second.compare_program(seen, "move_to")
            if second.doubts:
                self.position()
        except BaseException:
            self._armed = False
            raise
        second.at_rest(None)

    def _stock_move(self, target: tuple[float, ...], seconds: float) -> None:
        """Move with the stock dialect, and detect a stopped program.

        A stopped task never answers, nor does it in an emergency stop; the log distinguishes it from a dead link.
        """
        try:
            look = None if self.second is None else self._look_aside
            self._main.ask(2, target, deadline="move_s", seconds=seconds, meanwhile=look)
        except LinkTimeout as error:
            joints = None
            with self._back.lock, suppress(LinkError):
                self._back.link.open(connect_s=self.deadlines.ping_s)
                joints = self._back.log_joints()
            self._back.link.close()
            if joints is None or apart_deg(joints, target) < 0.1:
                raise
            raise ProtectiveStop(
                "the controller answers, but its program stopped on the way (emergency stop, supervision, limit)",
                device=self.name,
                command="move_to",
            ) from error

    def position(self) -> JointReading:
        """Return the joint angles that the controller reads back now.

        They are read until two answers agree, because neither dialect has a checksum. If the robot moves, the last
        answer is returned.

        Raises
        ------
        LinkError
            The connection failed, or the second channel saw other joints of a robot at rest.
        """
        reading = self._read_back()
        for _ in range(_MOST_LOOKS):
            before, reading = reading, self._read_back()
            if reading.joints_deg == before.joints_deg:
                break
        if self.second is not None:
            self.second.compare_joints(reading.joints_deg)
        return reading

    def _read_back(self) -> JointReading:
        if not self._superset:
            found = self._main.ask(4, (), _STOCK_JOINTS, quiet_s=self.deadlines.quiet_s, sure=_ENDED_JOINTS)
            return JointReading(
                self._joints(found[1].split(b" "), found[0]), 10.0**-_STOCK_DECIMALS, found[0]
            )
        joints, raw = self._calsrv.joints()
        return JointReading(joints, 10.0**-DECIMALS, raw)

    def stop(self) -> None:
        """Halt the robot now and disarm. From any thread.

        Raises
        ------
        CannotStop
            The controller runs the stock dialect, and there is no second channel.
        LinkError
            The stop was not answered, over the second channel neither.
        CommandRefused
            The second channel refused it.
        """
        self._armed = False
        self._stopped.set()
        if self._superset:
            try:
                self._calsrv.stop()
            except LinkError as error:
                if self.second is None:
                    raise
                _LOG.warning("%s", error)
            else:
                return
        if self.second is None:
            raise CannotStop("stock open_abb has no stop", device=self.name, command="stop")
        self.second.stop()

    def status(self) -> RobotStatus:
        """Return the state of the controller.

        The stock dialect only reports that the controller answers. With a second channel, its state is returned.

        Raises
        ------
        LinkError
            The connection failed.
        """
        if self._superset:
            return self._calsrv.status()
        self._main.ping()
        if self.second is not None:
            return self.second.fresh("status").status
        return RobotStatus("unknown", None, None, None)

    # -- checks -------------------------------------------------------------------------------------------

    def _settled(self, target: tuple[float, ...]) -> JointReading:
        """Wait until the robot is at the target and return its reading.

        Raises
        ------
        NotReached
            It is still away from the target after `settle_s`.
        MotionStopped
            It was stopped.
        LinkError
            The connection failed.
        """
        end = self._clock() + self.deadlines.settle_s
        while not is_there(reached := self.position(), target, self._hold_deg):
            if self._clock() >= end:
                off = apart_deg(reached.joints_deg, target)
                raise NotReached(
                    f"is {off:.3f} deg from where it was sent",
                    device=self.name,
                    command="move_to",
                    raw=reached.raw,
                )
            if self._stopped.wait(self.deadlines.gap_s):
                raise MotionStopped("stopped, or asked to stop", device=self.name, command="move_to")
        return reached

    def _move_seconds(self, target: tuple[float, ...]) -> float:
        where = self._where or (0.0,) * _JOINTS
        far = max(abs(a - b) for a, b in zip(target, where, strict=True))
        return self.deadlines.move_factor * far / self._speeds[1] + self.deadlines.move_margin_s

    def _look(self) -> None:
        """Feed the watchdog during a move, and detect states that T_ROB1 can no longer report."""
        if self._clock() < self._next_look:
            return
        self._next_look = self._clock() + 2 * self._main.link.poll_s
        if self._stopped.is_set():  # the stop may have overtaken the move: say it again
            self.stop()
            seen = None if self.second is None else self.second.last()
            if seen is not None and not seen.runs:  # a stopped program never says that the move has ended
                raise MotionStopped("stopped on its way", device=self.name, command="move_to")
        else:
            self._calsrv.raise_if_unfit(self.status(), "move_to")
            self._look_aside()

    def _look_aside(self) -> None:
        """Check the last state that the second channel saw during a move, without a question."""
        if self._stopped.is_set():  # open_abb answers no move that was stopped
            raise MotionStopped("stopped on its way", device=self.name, command="move_to")
        if self.second is None or (seen := self.second.last()) is None:
            return
        try:
            self._calsrv.raise_if_unfit(seen.status, "move_to")
            self.second.compare_program(seen, "move_to")
        except AcquisitionError:
            with suppress(AcquisitionError):  # the robot's own channel may not know: it could go on
                self.stop()
            raise

    def _joints(self, fields: Sequence[bytes], raw: bytes) -> tuple[float, ...]:
        joints = tuple(float(field) for field in fields)
        if not all(math.isfinite(q) and abs(q) < _WIDEST_DEG for q in joints):
            raise self._damaged("joint angle out of range", "position", raw)
        return joints

    def _damaged(self, message: str, command: str, raw: bytes) -> ProtocolError:
        self.disconnect()
        return ProtocolError(message, device=self.name, command=command, raw=raw)


def _access_to(
    address: Address, name: str, fingerprint: str, user: str, password_file: str
) -> Callable[[], RwsAccess] | None:
    """Return what gives access to the second channel, None if the address has no port for it.

    Raises
    ------
    ConfigError
        The port or the fingerprint is wrong, or the cell file describes a channel that the address lacks.
    """
    if "rws" not in address.options:
        if fingerprint or user or password_file:
            raise ConfigError(
                "the cell file describes Robot Web Services, and url has no port for them",
                device=name,
                what_to_do="Add ?rws=443 to url, or remove the keys that begin with rws_.",
            )
        return None
    port = beside(address, "rws", 0, name).port
    if "fingerprint" in address.options:
        pin = pinned(address.options["fingerprint"], name)
        return lambda: RwsAccess(address.host, port, pin)
    pin = pinned(fingerprint, name)

    def access() -> RwsAccess:
        who = user or FACTORY_USER
        if not password_file:
            return RwsAccess(address.host, port, pin, who)
        return RwsAccess(address.host, port, pin, who, password_in(password_file, name))

    return access
