"""Universal Robots (CB3 and e-Series) through interfaces that every controller has.

No program is installed on the controller. States come from RTDE (30004), or, if its port is closed, from the real-time
packet (30003). A move is a short URScript program sent to 30003. Nothing acknowledges it: it has ended when the
controller reports that no program runs, and target and actual joints agree and are at rest, never because time has
passed.

With RTDE of software 3.9 or later the program returns its own number and target in registers and waits until they were
compared. A damaged program then moves nothing, and an older end is not taken for this one. Its watchdog
(`rtde_set_watchdog`) stops the arm when this program is gone. Without those registers `weakness` states what is
missing.

`stopj` over a separate connection stops at any time; if 30003 does not answer, 30002 and the dashboard are used
(`drivers.ur.fallback_stop`). The other ports lie at their usual distances from the one in the URL; each can be given as
an option (`realtime`, `secondary`, `dashboard`), and `feed=realtime` does without RTDE.

The driver has not been tried on a controller yet.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager

from drivers.errors import (
    AcquisitionError,
    ConfigError,
    LinkError,
    LinkLost,
    NotArmed,
)
from drivers.interfaces import Identity, JointReading, RobotStatus, Sample
from drivers.limits import Caps
from drivers.link import Address, TcpLink, WireSink, beside, parse_url
from drivers.ur.dashboard import order, read_serial
from drivers.ur.deadlines import SERVICES, UrDeadlines
from drivers.ur.fallback_stop import halt_elsewhere
from drivers.ur.motion import STOP_SCRIPT, Motion, MotionLimits, not_ready
from drivers.ur.realtime import Realtime
from drivers.ur.rtde import Rtde, joint_stream
from drivers.ur.secondary import Factory, read_factory
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
        if feed not in ("rtde", "realtime"):
            raise ConfigError(
                f"feed={feed!r} in {url!r} is neither rtde nor realtime",
                device=name,
                what_to_do="Use feed=rtde or feed=realtime.",
            )
        self.name = name
        self._address, self._wire, self._clock = address, wire, clock
        self._deadlines = deadlines or UrDeadlines()
        self._caps = caps
        self._secondary = beside(address, "secondary", address.port - 2, name)
        self._dashboard = beside(address, "dashboard", address.port - 5, name)
        self._rtde = Rtde(self._link(address), self._deadlines)
        realtime = beside(address, "realtime", address.port - 1, name)
        self._to_realtime = lambda: self._link(realtime)
        self._realtime = Realtime(self._to_realtime, name, self._deadlines)
        self._only_realtime = feed == "realtime"
        self._feed: Rtde | Realtime = self._realtime if self._only_realtime else self._rtde
        allowed = MotionLimits(
            speed_mm_s,
            reach_mm,
            math.radians(speed_deg_s),
            math.radians(acceleration_deg_s2),
            math.radians(hold_deg),
            watchdog_s,
        )
        self._motion = Motion(self._realtime, name, allowed, clock)
        self._lock = threading.RLock()
        self._armed = False
        self._warned = False
        self._serials: dict[str, str] = {}  # of arms that were met, by the name of their calibration

    def _link(self, address: Address) -> TcpLink:
        return TcpLink(address, self.name, wire=self._wire, clock=self._clock, enabled_at=SERVICES)

    @property
    def deadlines(self) -> UrDeadlines:
        """The named waits; may be replaced between questions."""
        return self._deadlines

    @deadlines.setter
    def deadlines(self, deadlines: UrDeadlines) -> None:
        self._deadlines = self._rtde.deadlines = self._realtime.deadlines = deadlines

    # -- connection ---------------------------------------------------------------------------------------

    @property
    def can_stop(self) -> bool:
        """True: every UR controller can be stopped by network."""
        return True

    @property
    def feed(self) -> str:
        """The source of states that the last connect found: `rtde` or `realtime`."""
        return "rtde" if self._feed is self._rtde else "realtime"

    @property
    def weakness(self) -> str:
        """The errors that cannot be detected on this controller. Once connected.

        The text is empty if a program is confirmed before it moves.
        """
        if self._feed.confirms:
            return ""
        closed = self._feed is self._realtime and not self._only_realtime
        return (
            f"the port of RTDE is closed ({SERVICES.removesuffix('.')}); {_WEAKNESS}" if closed else _WEAKNESS
        )

    def connect(self) -> None:
        """Open RTDE or the real-time packet, and read the joints. Nothing moves.

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
                self._feed = self._realtime if self._only_realtime else self._rtde
                self._open_feed()
                self.position()
            except BaseException:
                self.disconnect()
                raise
        if first and self.weakness:
            _LOG.warning("%s: %s", self.name, self.weakness)

    def _open_feed(self) -> None:
        try:
            self._feed.open()
        except LinkLost as error:
            if self._only_realtime or not isinstance(error.__cause__, ConnectionRefusedError):
                raise
            self._realtime.open()
            self._feed = self._realtime
            _LOG.warning("%s: nobody answers RTDE; without it no watchdog guards a move", self.name)

    def disconnect(self) -> None:
        """Close all connections and disarm; never raises.

        A move under way notices it and orders the arm to stop.
        """
        self._armed = False
        self._motion.stopped.set()  # a program that is about to be sent stays here
        self._rtde.close()
        self._realtime.close()

    def identify(self) -> Identity:
        """Return type of the arm, software, and serial number.

        The serial number comes from the dashboard, if it reports one (software 3.12 and 5.6 or later, and open).
        Otherwise it is the name of the factory calibration, which no two arms share; that name is always the alias.

        Raises
        ------
        LinkError
            The connection failed.
        """
        factory = self.factory()
        name = factory.calibration
        serial = read_serial(self._dashboard, self.name, self._deadlines, self._wire)
        if serial:
            self._serials[name] = serial
        else:
            serial = self._serials.get(name, name)
        return Identity("Universal Robots", factory.model, serial, factory.firmware, self.feed, alias=name)

    def in_remote_control(self) -> bool | None:
        """Ask the dashboard whether the controller accepts programs by network.

        The result is None if the dashboard does not report it (CB3).
        """
        told = order(self._dashboard, "is in remote control", self.name, self._deadlines, self._wire)
        return {b"true": True, b"false": False}.get(told.lower())

    def factory(self) -> Factory:
        """Return the nominal and factory-calibrated DH numbers of this arm, from 30002.

        Raises
        ------
        LinkError
            The connection failed.
        """
        return read_factory(self._secondary, self.name, self._deadlines, self._wire)

    # -- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Become the one client that controls, check the controller, allow motion.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            Another client controls the robot.
        SafetyStop
            The controller is in a safety stop.
        WrongMode
            The arm is not running.
        """
        with self._lock:
            self._feed.claim()
            with self._feed.watch("arm") as witness:
                state = witness.state()
            problem = not_ready(state)
            if problem is not None:
                raise self._named(problem, "arm")
            self._motion.stopped.clear()
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
        return joint_stream(Rtde(self._link(self._address), self._deadlines, rate_hz))

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
            self._motion.halt(Realtime(self._to_realtime, self.name, quick))
        except LinkError as error:
            _LOG.warning("%s", error)
            rtde = Rtde(self._link(self._address), quick)
            script, elsewhere = STOP_SCRIPT.encode("ascii"), (self._secondary, self._dashboard)
            try:
                halt_elsewhere(script, *elsewhere, rtde, quick, self._wire, self._clock)
            except LinkError:  # a stop is worth another try with patience
                self._motion.halt()

    def status(self) -> RobotStatus:
        """Return the state of the controller, over a separate connection.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._realtime.watch("status") as witness:
            state = witness.state()
        return RobotStatus(
            mode="unknown",
            motors_on=state.robot_mode == RUNNING,
            emergency_stop=state.safety_mode in (6, 7),
            moving=not state.at_rest,
            error_number=state.safety_mode if state.safety_mode > 2 else None,
            raw=state.raw,
        )

    def _named(self, error: AcquisitionError, command: str) -> AcquisitionError:
        error.device, error.command = self.name, command
        return error


def _reading(state: UrState) -> JointReading:
    """Return the reading of a state, which has doubles and is therefore not rounded."""
    return JointReading(tuple(math.degrees(q) for q in state.actual_rad), 0.0, state.raw)
