"""Fanuc R-30iA and later: three protocols, chosen by the address, and RMI.

    tcp://192.168.1.10:18735                 MAPPDK text dialect; second connection on the next port
    tcp://192.168.1.10:502?modbus=hmi        Modbus TCP, registers R[] and PR[] (option R553, from V8.30)
    tcp://192.168.1.10:502?modbus=io         Modbus TCP, group signals only (R-30iA)
    tcp://192.168.1.10:16001                 driver `fanuc-rmi`: RMI (option R912, from R-30iB Plus); `?session=PORT`
                                             replaces the port that the controller hands over, behind a router

`drivers.fanuc.mappdk`, `modbus` and `rmi` implement the protocols; this module has what they share. All angles
are those that the controller counts, as in a data set with `joint_coupling = "fanuc-j23"`.

A stock MAPPDK move ends in CNT, never FINE: its answer may come before the robot is at rest. Every move is therefore
followed by readings until two of them, some time apart, agree with each other and with the target. Every other
reading is taken twice as well, so that a damaged digit does not pass. Nothing here was tried on a controller yet.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import ClassVar

from drivers.errors import (
    Busy,
    CannotStop,
    ConfigError,
    MotionStopped,
    NotArmed,
    NotReached,
)
from drivers.fanuc.controller import (
    JOINTS,
    WIDEST_DEG,
    FanucController,
    FanucDeadlines,
    JointMove,
    raise_if_unfit,
)
from drivers.fanuc.mappdk import MappdkController
from drivers.fanuc.rmi import RmiController
from drivers.interfaces import Identity, JointReading, RobotStatus, apart_deg, is_there
from drivers.limits import Caps
from drivers.link import TcpLink, WireSink, parse_url

_LOG = logging.getLogger(__name__)
_MAX_DEG_S = (350.0, 350.0, 400.0, 450.0, 450.0, 720.0)  # LR Mate 200iC, data sheet; `?max_deg_s=` for others
Protocols = Mapping[str | None, Callable[[TcpLink, FanucDeadlines], FanucController]]
_AGREE_DEG = 0.002  # two readings of a robot at rest: twice the resolution of MAPPDK


def _modbus(link: TcpLink, deadlines: FanucDeadlines) -> FanucController:
    from drivers.fanuc.modbus import ModbusController  # pymodbus, of the extra `cell`

    return ModbusController(link, deadlines)


class FanucArm:
    """The driver of a Fanuc robot.

    Methods block; `stop` and `status` answer while another thread waits for a move.

    Parameters
    ----------
    hold_deg
        Largest distance from its target at which a servo may hold a joint (`drivers.interfaces`).
    """

    unverified_on_hardware = True
    usual_name: ClassVar[str] = "fanuc"
    protocols: ClassVar[Protocols] = {None: MappdkController, "hmi": _modbus, "io": _modbus}

    def __init__(
        self,
        url: str,
        *,
        name: str | None = None,
        speed_mm_s: float = 500.0,
        speed_deg_s: float = 20.0,
        limits_deg: Sequence[Sequence[float]] | None = None,
        hold_deg: float = 0.003,
        deadlines: FanucDeadlines | None = None,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        name = self.usual_name if name is None else name
        caps = Caps(speed_mm_s, speed_deg_s, limits_deg, joints=JOINTS, widest_deg=WIDEST_DEG, device=name)
        address = parse_url(url)
        kind = address.options.get("modbus")
        if kind not in self.protocols:
            raise ConfigError(
                f"modbus={kind!r} in {url!r} is neither hmi nor io, or the driver is {name}",
                device=name,
                what_to_do="Use modbus=hmi or modbus=io with the driver fanuc.",
            )
        self.name = name
        self._max_deg_s = _speeds(address.options.get("max_deg_s"), url)
        self._caps = caps
        self._hold_deg = hold_deg
        self._clock = clock
        link = TcpLink(address, name, wire=wire, clock=clock)
        self._controller = self.protocols[kind](link, deadlines or FanucDeadlines())
        self._lock = threading.RLock()
        self._armed = False
        self._stopped = threading.Event()
        self._where: tuple[float, ...] | None = None
        self._warned = False

    @property
    def deadlines(self) -> FanucDeadlines:
        """The named waits; may be replaced between questions."""
        return self._controller.deadlines

    @deadlines.setter
    def deadlines(self, deadlines: FanucDeadlines) -> None:
        self._controller.deadlines = deadlines

    # -- connection ---------------------------------------------------------------------------------------

    @property
    def can_stop(self) -> bool:
        """False for a stock MAPPDK server; valid once connected."""
        return self._controller.can_stop

    @property
    def dialect(self) -> str:
        """`mappdk`, `mappdk-cal`, `modbus-hmi`, `modbus-io` or `rmi`, as found by the last connect."""
        return self._controller.dialect

    @property
    def weakness(self) -> str:
        """The errors that this dialect cannot detect.

        The text is empty if a target is confirmed before it moves the robot.
        """
        return self._controller.weakness

    def connect(self) -> None:
        """Open, detect the dialect, read the joints. Nothing moves.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            The robot is moving.
        """
        first, self._warned = not self._warned, True
        if first:
            _LOG.warning("%s: this Fanuc driver is unverified on hardware", self.name)
        with self._lock:
            self.disconnect()
            try:
                self._controller.open()
                self._where = self.position().joints_deg
            except BaseException:
                self.disconnect()
                raise
        if first and self.weakness:
            _LOG.warning("%s: %s", self.name, self.weakness)

    def disconnect(self) -> None:
        """Close every connection and disarm; never raises."""
        self._armed = False
        self._where = None
        self._controller.close()

    def identify(self) -> Identity:
        """Return the identity from the controller; stock MAPPDK, Modbus and RMI report no model.

        Raises
        ------
        LinkError
            The connection failed.
        """
        return self._controller.identity()

    # -- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Check the controller and its programs; allow motion.

        Raises
        ------
        LinkError
            The connection failed.
        SafetyStop
            The controller is stopped.
        WrongMode
            The pendant is enabled, or the servo power is off.
        NotReady
            The robot's program does not run.
        Busy
            Another client's move is under way.
        """
        with self._lock:
            raise_if_unfit(self._controller.status(), self.name, "arm")
            self._controller.prepare()
            self._where = self.position().joints_deg
            self._stopped.clear()
            self._armed = True

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
        SafetyStop, WrongMode, MotionStopped
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
                percent, seconds = self._pace(target)
                self._controller.move(JointMove(target, percent, seconds, self._stopped))
                reached = self._settled(target)
            except BaseException:
                self._armed = False  # wherever the robot is now, a person has to check first
                raise
            self._where = reached.joints_deg
        return reached

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
            before = self._controller.joints()
            while True:
                time.sleep(self.deadlines.gap_s)  # two answers in a row may agree although the robot moves
                now = self._controller.joints()
                if _apart(before, now) <= _AGREE_DEG:
                    return now
                if self._clock() >= end:
                    raise Busy("the robot is still moving", device=self.name, command="position", raw=now.raw)
                before = now

    def stop(self) -> None:
        """Halt the robot now and disarm. From any thread.

        Raises
        ------
        CannotStop
            The controller runs stock MAPPDK.
        LinkError
            The stop was not answered.
        """
        self._armed = False
        self._stopped.set()
        if not self._controller.can_stop:
            raise CannotStop("stock MAPPDK has no stop", device=self.name, command="stop")
        self._controller.halt()

    def status(self) -> RobotStatus:
        """Return the state of the controller, with the facts that the dialect reports.

        Raises
        ------
        LinkError
            The connection failed.
        """
        return self._controller.status()

    def _settled(self, target: tuple[float, ...]) -> JointReading:
        """Wait until the robot is at the target and return its reading."""
        end = self._clock() + self.deadlines.settle_s
        before = self._controller.joints()
        while True:
            if self._stopped.wait(self.deadlines.gap_s):
                raise MotionStopped("stopped, or asked to stop", device=self.name, command="move_to")
            now = self._controller.joints()
            if is_there(now, target, self._hold_deg) and _apart(before, now) <= _AGREE_DEG:
                return now
            if self._clock() >= end:
                raise NotReached(
                    f"{apart_deg(now.joints_deg, target):.3f} deg from where it was sent, "
                    f"settle_s = {self.deadlines.settle_s:g} s after the reported end",
                    device=self.name,
                    command="move_to",
                    raw=now.raw,
                )
            before = now

    # -- checks -------------------------------------------------------------------------------------------

    def _pace(self, target: tuple[float, ...]) -> tuple[int, float]:
        """Choose the speed in whole percent, at least 1, and the longest time of the move (s).

        The speed is within both speed limits. A Fanuc joint move at p % takes max |dq_i| / (p v_i). Its tool is nowhere
        faster than sum |dq_i| lever_i / time.
        """
        where = self._where or (0.0,) * JOINTS
        far = [abs(a - b) for a, b in zip(target, where, strict=True)]
        wanted_s = self._caps.seconds(far)
        full_s = max(dq / top for dq, top in zip(far, self._max_deg_s, strict=True))
        percent = max(1, min(100, math.floor(100 * full_s / wanted_s))) if wanted_s > 0 else 1
        return percent, self.deadlines.move_factor * 100 * full_s / percent + self.deadlines.move_margin_s


class FanucRmiArm(FanucArm):
    """The driver of a Fanuc robot with Remote Motion Interface."""

    usual_name = "fanuc-rmi"
    protocols: ClassVar[Protocols] = {None: RmiController}


def _apart(one: JointReading, two: JointReading) -> float:
    return apart_deg(one.joints_deg, two.joints_deg)


def _speeds(text: str | None, url: str) -> tuple[float, ...]:
    """Return the `max_deg_s` of the address: the fastest speed of each joint.

    Raises
    ------
    ConfigError
        The text is not one speed per joint.
    """
    if text is None:
        return _MAX_DEG_S
    try:
        speeds = tuple(float(word) for word in text.split(","))
    except ValueError:
        speeds = ()
    if len(speeds) != JOINTS or not all(0 < speed < math.inf for speed in speeds):
        raise ConfigError(
            f"max_deg_s={text!r} in {url!r} is not {JOINTS} speeds, as 350,350,400,450,450,720",
            what_to_do="Give one speed in deg/s per joint, separated by commas.",
        )
    return speeds
