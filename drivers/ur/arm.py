"""Universal Robots (CB3, e-Series, PolyScope X) through interfaces of every controller.

No program is installed on the controller. States come from RTDE (30004), or, if its port is closed, from the port that
takes programs: the real-time packet (30003) or, if that is closed as well, the primary interface (30001). A move is a
short URScript program sent to that port. Nothing acknowledges it: it has ended when the controller reports that no
program runs, and target and actual joints agree and are at rest, never because time has passed.

With RTDE of software 3.9 or later the program returns its own number and target in registers and waits until they were
compared. A damaged program then moves nothing, and an older end is not taken for this one. Its watchdog
(`rtde_set_watchdog`) stops the arm when this program is gone. Without those registers `weakness` states what is
missing.

`stopj` over a separate connection stops at any time. If that port does not answer, the stop goes to the others that
take programs, and to the dashboard or the Robot API of PolyScope X (`drivers.ur.fallback_stop`). The other ports lie at
their usual distances from the one in the URL. Each can be given as an option (`realtime`, `secondary`, `primary`,
`dashboard`, `api`), and `feed=realtime` or `feed=primary` does without RTDE. `drivers.ur.software` lists the services
that PolyScope closes, and where a person opens them.

Programs are refused under local control; arming asks for it. This driver never powers the arm, unlocks a protective
stop or starts a stored program, although PolyScope X and the dashboard can: a person does, who sees the arm.

The driver has not been tried on a controller yet.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, suppress

from drivers.errors import (
    AcquisitionError,
    ConfigError,
    LinkError,
    LinkLost,
    MotionStopped,
    NotArmed,
    WrongMode,
)
from drivers.interfaces import Identity, JointReading, RobotStatus, Sample
from drivers.limits import Caps
from drivers.link import TcpLink, WireSink, beside, parse_url
from drivers.ur.dashboard import order, read_serial, read_software_version
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.fallback_stop import halt_elsewhere
from drivers.ur.motion import STOP_SCRIPT, Motion, MotionLimits, not_ready
from drivers.ur.primary import Primary, in_local_control
from drivers.ur.realtime import Realtime
from drivers.ur.robot_api import PORT, RobotApi
from drivers.ur.rtde import Rtde, joint_stream
from drivers.ur.script_port import ScriptPort, refuses
from drivers.ur.secondary import Factory, read_factory, read_software
from drivers.ur.software import (
    DASHBOARD,
    E_SERIES,
    POLYSCOPE_X,
    PRIMARY,
    REALTIME,
    RTDE,
    SECONDARY,
    Software,
    can_close,
    where_enabled,
)
from drivers.ur.state import JOINTS, RUNNING, UrState

_LOG = logging.getLogger(__name__)
_WIDEST_DEG = 360.0
# From full speed, 3.2 rad/s, with the 4 rad/s2 of a stop, plus the reaction time of the controller.
_BRAKES_S = 1.5
_WEAKNESS = (
    "without the registers of RTDE (software 3.9) a program moves the arm as it arrives: one that is damaged on its "
    "way moves it elsewhere or at another speed, and is seen only afterwards, from 0.0006 deg on"
)


class UrArm:
    """The driver of a UR arm.

    Methods block; `stop` and `status` use separate connections and work from any thread.

    Parameters
    ----------
    reach_mm
        Distance from axis 1 to the end of the tool, arm outstretched (850 for a UR5, 1300 for a UR10, plus the tool).
        The speed of the joints is limited so that the tool there stays below `speed_mm_s`.
    hold_deg
        Largest distance from its target at which a servo may hold a joint (`drivers.interfaces`).
    """

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "ur",
        speed_mm_s: float = 500.0,
        speed_deg_s: float = 20.0,
        reach_mm: float = 1000.0,
        acceleration_deg_s2: float = 60.0,
        limits_deg: Sequence[Sequence[float]] | None = None,
        hold_deg: float = 0.013,
        watchdog_s: float = 2.0,
        deadlines: UrDeadlines | None = None,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        if not min(reach_mm, acceleration_deg_s2, watchdog_s) > 0:
            raise ConfigError(
                "reach, acceleration and watchdog must be positive",
                device=name,
                what_to_do="Correct them in the cell file.",
            )
        caps = Caps(speed_mm_s, speed_deg_s, limits_deg, joints=JOINTS, widest_deg=_WIDEST_DEG, device=name)
        address = parse_url(url)
        feed = address.options.get("feed", "rtde")
        if feed not in ("rtde", "realtime", "primary"):
            raise ConfigError(
                f"feed={feed!r} in {url!r} is neither rtde, realtime nor primary",
                device=name,
                what_to_do="Use feed=rtde, feed=realtime or feed=primary.",
            )
        self.name = name
        self._wire, self._clock = wire, clock
        self._deadlines = deadlines or UrDeadlines()
        self._caps = caps
        self._software: Software | None = None
        self._places = {RTDE: address} | {
            service: beside(address, option, address.port - distance, name)
            for service, option, distance in (
                (REALTIME, "realtime", 1),
                (SECONDARY, "secondary", 2),
                (PRIMARY, "primary", 3),
                (DASHBOARD, "dashboard", 5),
            )
        }
        self._api = RobotApi(beside(address, "api", PORT, name), name, self._deadlines, wire)
        self._rtde = Rtde(self._link(RTDE), self._deadlines)
        self._ports: tuple[ScriptPort, ...] = (
            Realtime(lambda: self._link(REALTIME), name, self._deadlines),
            Primary(lambda: self._link(PRIMARY), name, self._deadlines),
        )
        if feed != "rtde":
            self._ports = tuple(port for port in self._ports if port.name == feed)
        self._chosen: ScriptPort | None = None
        self._without_rtde = feed != "rtde"
        self._feed: Rtde | ScriptPort = self._ports[0] if self._without_rtde else self._rtde
        allowed = MotionLimits(
            speed_mm_s,
            reach_mm,
            math.radians(speed_deg_s),
            math.radians(acceleration_deg_s2),
            math.radians(hold_deg),
            watchdog_s,
        )
        self._motion = Motion(self._port, name, allowed, clock)
        self._lock = threading.RLock()
        self._armed = False
        self._warned = False
        self._serials: dict[str, str] = {}  # of arms that were met, by the name of their calibration

    def _link(self, service: str) -> TcpLink:
        return TcpLink(
            self._places[service],
            self.name,
            wire=self._wire,
            clock=self._clock,
            enabled_at=lambda: where_enabled(service, self.software()),
        )

    def _port(self) -> ScriptPort:
        """The port that takes programs: the first that is not closed when it was needed first."""
        if self._chosen is None:
            candidates = self._ports if can_close(self._software) else self._ports[:1]
            open_ports = (port for port in candidates[:-1] if not self._is_closed(port.service))
            self._chosen = next(open_ports, candidates[-1])
        return self._chosen

    def software(self) -> Software | None:
        """Return the software of the controller, None if no port reports it."""
        asks: tuple[Callable[[], Software | None], ...] = (
            lambda: read_software(self._plain_link(PRIMARY), self._deadlines.quick),
            lambda: read_software(self._plain_link(SECONDARY), self._deadlines.quick),
            lambda: read_software_version(
                self._places[DASHBOARD], self.name, self._deadlines.quick, self._wire
            ),
            self._api.software,
        )
        for ask in asks:
            if self._software is None:
                with suppress(LinkError):
                    self._software = ask()
        return self._software

    def _plain_link(self, service: str) -> TcpLink:
        return TcpLink(self._places[service], self.name, wire=self._wire, clock=self._clock)

    @property
    def deadlines(self) -> UrDeadlines:
        """The named waits; may be replaced between questions."""
        return self._deadlines

    @deadlines.setter
    def deadlines(self, deadlines: UrDeadlines) -> None:
        self._deadlines = self._rtde.deadlines = deadlines
        for port in self._ports:
            port.deadlines = deadlines

    # -- connection ---------------------------------------------------------------------------------------

    @property
    def can_stop(self) -> bool:
        """True: every UR controller can be stopped by network."""
        return True

    @property
    def feed(self) -> str:
        """The source of states that the last connect found: `rtde`, `realtime` or `primary`."""
        return self._feed.name

    @property
    def weakness(self) -> str:
        """The errors that cannot be detected on this controller. Once connected.

        The text is empty if a program is confirmed before it moves.
        """
        if self._feed.confirms:
            return ""
        closed = self._feed is not self._rtde and not self._without_rtde
        where = where_enabled(RTDE, self._software).removesuffix(".")
        return f"the port of RTDE is closed ({where}); {_WEAKNESS}" if closed else _WEAKNESS

    def connect(self) -> None:
        """Open RTDE or another stream of states, and read the joints. Nothing moves.

        Raises
        ------
        LinkError
            The connection failed.
        """
        first, self._warned = not self._warned, True
        if first:
            _LOG.warning("%s: this UR driver is unverified on hardware", self.name)
        with self._lock:
            self.disconnect()
            try:
                self._chosen = self._software = None
                self._open_feed()
                self.position()
            except BaseException:
                self.disconnect()
                raise
        if first and self.weakness:
            _LOG.warning("%s: %s", self.name, self.weakness)

    def _open_feed(self) -> None:
        self._feed = self._port() if self._without_rtde else self._rtde
        try:
            self._feed.open()
            if self._feed is self._rtde:
                self._software = self._rtde.software
        except LinkLost as error:
            if self._without_rtde or not _is_refused(error):
                raise
            self._feed = self._port()
            try:
                self._feed.open()
            except LinkLost as other:
                if _is_refused(other):
                    error.what_to_do = where_enabled(f"{RTDE} and {PRIMARY}", self.software())
                    raise error from other.__cause__
                raise
            _LOG.warning("%s: nobody answers RTDE; without it no watchdog guards a move", self.name)

    def disconnect(self) -> None:
        """Close all connections and disarm; never raises.

        A move under way notices it and orders the arm to stop.
        """
        self._armed = False
        self._motion.stopped.set()  # a program that is about to be sent stays here
        self._rtde.close()
        for port in self._ports:
            port.close()

    def identify(self) -> Identity:
        """Return type of the arm, software, and serial number.

        The serial number comes from the dashboard, if it reports one (software 3.12 and 5.6 or later, and open), or
        from the Robot API (10.14). Otherwise it is the name of the factory calibration, which no two arms share; that
        name is always the alias.

        Raises
        ------
        LinkError
            The connection failed.
        """
        factory = self.factory()
        name = factory.calibration
        serial = read_serial(self._places[DASHBOARD], self.name, self._deadlines, self._wire)
        if not serial and self._is_polyscope_x:
            serial = self._api.serial()
        if serial:
            self._serials[name] = serial
        else:
            serial = self._serials.get(name, name)
        return Identity(
            "Universal Robots",
            factory.model,
            serial,
            factory.firmware,
            self.feed,
            alias=name,
            calibration=factory.held,
        )

    @property
    def _is_polyscope_x(self) -> bool:
        return self._software is not None and self._software >= POLYSCOPE_X

    def in_remote_control(self) -> bool | None:
        """Ask whether the controller accepts programs by network, while none runs.

        The dashboard is asked, then the Robot API (software 10.12), then the primary interface, to which a program is
        sent that writes one line and cannot move. The result is None if none of them reports it (CB3).
        """
        software = self.software()
        if software is not None and software < E_SERIES:
            return None
        told = order(self._places[DASHBOARD], "is in remote control", self.name, self._deadlines, self._wire)
        answer = {b"true": True, b"false": False}.get(told.lower())
        if answer is None and self._is_polyscope_x:
            answer = self._api.in_remote_control()
        if answer is None and software is not None:
            answer = Primary(lambda: self._plain_link(PRIMARY), self.name, self._deadlines).takes_programs()
        return answer

    def local_control(self) -> WrongMode | None:
        """Return the error of a controller in local control, None if it is not or does not report."""
        return in_local_control(self._software) if self.in_remote_control() is False else None

    def closed_services(self) -> tuple[str, ...]:
        """Return the services of this controller that are closed, by their names in its menu."""
        services = self._places if not self._is_polyscope_x else (RTDE, PRIMARY, SECONDARY)
        return tuple(service for service in services if self._is_closed(service))

    def _is_closed(self, service: str) -> bool:
        return refuses(self._plain_link(service), self._deadlines.quick.connect_s)

    def factory(self) -> Factory:
        """Return the nominal and factory-calibrated DH numbers of this arm, from 30002 or 30001.

        Raises
        ------
        LinkError
            The connection failed.
        """
        try:
            return read_factory(self._link(SECONDARY), self._deadlines)
        except LinkLost as error:
            if _is_refused(error):
                with suppress(LinkError):
                    return read_factory(self._plain_link(PRIMARY), self._deadlines)
            raise

    # -- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Become the one client that controls, check the controller, allow motion. Nothing moves.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            Another client controls the robot.
        SafetyStop
            The controller is in a safety stop.
        WrongMode
            The arm is not running, or the controller is in local control.
        MotionStopped
            A stop came meanwhile.
        """
        with self._lock:
            self._motion.stopped.clear()
            self._feed.claim()
            with self._feed.watch("arm") as witness:
                state = witness.state()
            problem = not_ready(state) or self.local_control()
            if problem is not None:
                raise self._named(problem, "arm")
            self._armed = True
            if self._motion.stopped.is_set():
                self._armed = False
                raise MotionStopped("stopped before it was armed", device=self.name, command="arm")

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
            The connection failed, and the position of the robot is unknown. The arm is ordered to stop, and its
            watchdog stops it.
        SafetyStop, WrongMode, MotionStopped
            The robot was stopped on its way.
        Busy
            Another program runs.
        NotReached
            The robot is not at its target.
        """
        target = tuple(float(q) for q in joints_deg)
        self._caps.check(target)
        with self._lock:
            if not self._armed:
                raise NotArmed("motion without arming", device=self.name, command="move_to")
            try:
                state, problem = self._motion.move(self._feed, tuple(math.radians(q) for q in target))
                if problem is not None:
                    raise self._named(problem, "move_to")
            except BaseException:
                self._armed = False  # wherever the robot is now, a person has to check first
                raise
        return _reading(state)

    def position(self) -> JointReading:
        """Return the joint angles that the controller reads back now.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._lock, self._feed.watch("position") as witness:
            state = witness.state()
        return _reading(state)

    def stream(self, rate_hz: float) -> AbstractContextManager[Iterator[Sample]]:
        """Stream the joints as they are read back, up to 125 Hz of a CB3, 500 Hz of an e-Series.

        The stream runs over RTDE, in parallel with all other questions. It needs RTDE, also if states otherwise come
        from the real-time packet.

        Raises
        ------
        LinkError
            The connection failed.
        """
        return joint_stream(Rtde(self._link(RTDE), self._deadlines, rate_hz))

    def at_speed(self, speed_deg_s: float) -> AbstractContextManager[None]:
        """Limit the speed of moves in the block, below the arm's own limits. From one thread."""
        return self._motion.at_most(math.radians(speed_deg_s))

    def stop(self) -> None:
        """Halt the robot now and disarm, and wait until it is at rest. From any thread.

        Raises
        ------
        LinkError
            The connection failed, or the arm did not obey and came to rest at the end of its program: a controller that
            was switched to local control accepts no order.
        """
        self._armed = False
        self._motion.stopped.set()
        goal, begin = self._motion.goal, self._clock()
        self._halt()
        if goal is not None and self._clock() - begin > _BRAKES_S and self._motion.went_on(goal):
            raise LinkError(
                "the arm did not obey the stop: it went on to its target", device=self.name, command="stop"
            )

    def _halt(self) -> None:
        quick = self._deadlines.quick
        try:
            self._motion.halt(self._port().hasty())
        except LinkError as error:
            _LOG.warning("%s", error)
            others = [port for port in self._ports if port is not self._port()]
            links = [self._plain_link(service) for service in (SECONDARY, *(port.service for port in others))]
            feeds = (Rtde(self._plain_link(RTDE), quick), *(port.hasty() for port in others))
            ends: list[Callable[[], object]] = [
                lambda: order(self._places[DASHBOARD], "stop", self.name, quick, self._wire)
            ]
            if self._is_polyscope_x:
                ends.append(self._api.stop)
            try:
                halt_elsewhere(STOP_SCRIPT.encode("ascii"), links, ends, feeds, quick, self._clock)
            except LinkError:  # a stop is worth another try with patience
                self._motion.halt()

    def status(self) -> RobotStatus:
        """Return the state of the controller, over a separate connection.

        Raises
        ------
        LinkError
            The connection failed.
        """
        state = self.look()
        return RobotStatus(
            mode="unknown",
            motors_on=state.robot_mode == RUNNING,
            emergency_stop=state.emergency_stop,
            moving=not state.at_rest,
            error_number=state.safety_mode if state.safety_mode > 2 else None,
            raw=state.raw,
        )

    def look(self) -> UrState:
        """Return the state from the port that takes programs, over a separate connection.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._port().watch("status") as witness:
            return witness.state()

    def _named(self, error: AcquisitionError, command: str) -> AcquisitionError:
        error.device, error.command = self.name, command
        return error


def _is_refused(error: LinkError) -> bool:
    return isinstance(error.__cause__, ConnectionRefusedError)


def _reading(state: UrState) -> JointReading:
    """Return the reading of a state, which has doubles and is therefore not rounded."""
    return JointReading(tuple(math.degrees(q) for q in state.actual_rad), 0.0, state.raw)
