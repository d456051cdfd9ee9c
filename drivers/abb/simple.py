"""ABB IRC5 with ROS-Industrial's abb_driver: `simple_message` over TCP.

TCP 11000 is for motion and 11002 for states. The state port is two above that of the address, or
`tcp://192.168.125.1:11000?state=12002`. Packets are in `drivers.abb.simple_packets`, the states in
`drivers.abb.simple_stream`. The protocol has these consequences:

- A trajectory is acknowledged when it was received, never when it was carried out. A move has ended when two
  consecutive states report that the robot does not move and agree with each other and with the target.
- A point nearer than 0.1 deg is skipped when it is the first of its trajectory. Each trajectory therefore has two: the
  present joints, and the target. External axes are ordered to stay where they are.
- Angles are float32 radians, sent and received: 1.4e-5 deg at 180 deg. Speed is sent as a duration.
- The server accepts a second client but does not read from it; it carries out that client's messages when the first
  client disconnects. `connect` therefore sends a stop, which moves nothing, and no point is sent before that stop was
  answered.
- The stop (sequence -4) is read while the robot moves, hence `can_stop`. There is no watchdog: a robot whose client
  is gone finishes its move. Whenever a move does not end well the driver sends a stop, over a new connection if needed.
- Nothing has a checksum. The position of the robot, and the start of a trajectory, are accepted from three consecutive
  states that agree; at the end of a move from two that agree with the target. Two alone do not suffice: two damaged
  states can agree, if both joints are near 0 and each lost a bit of its exponent. A point that is damaged on its way
  moves the robot, which only the read-back shows, as `weakness` states.

Angles are those that the controller counts; some ABB arms couple joints 2 and 3. The driver has not been tried on a
controller.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import ExitStack

from drivers.abb.simple_motion import MotionServer, patiently
from drivers.abb.simple_packets import END, JOINTS, START, AbbState, raise_if_unfit
from drivers.abb.simple_stream import AbbSimpleDeadlines, StateStream
from drivers.errors import (
    Busy,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    NotArmed,
    NotReached,
)
from drivers.interfaces import Identity, JointReading, RobotStatus, apart_deg, is_there
from drivers.limits import Caps
from drivers.link import TcpLink, WireSink, beside, parse_url

_LOG = logging.getLogger(__name__)
_WIDEST_DEG = 1000.0
_RAMP_S = 0.5  # added to every duration: the caps hold while the robot speeds up and slows down
_AGREE_DEG, _AGREE_M = 0.002, 1e-4  # two states of a robot at rest and of its external axes
_ALIKE = 3  # this number of consecutive states that agree is accepted
_WEAKNESS = (
    "simple_message has no checksum and moves on a trajectory at once: a point that is damaged on its way moves the "
    "robot there, and is seen only afterwards, from 0.002 deg on"
)
_SILENT = "Check that all three ROS programs run on the controller and that no other program is connected to the robot."


class AbbSimpleArm:
    """The driver of an ABB robot that runs abb_driver.

    Methods block; `stop` and `status` may be called from any thread.

    Parameters
    ----------
    hold_deg
        Largest distance from its target at which a servo may hold a joint (`drivers.interfaces`).
    """

    unverified_on_hardware = True

    def __init__(
        self,
        url: str,
        *,
        name: str = "abb-simple",
        speed_mm_s: float = 500.0,
        speed_deg_s: float = 20.0,
        limits_deg: Sequence[Sequence[float]] | None = None,
        hold_deg: float = 0.002,
        deadlines: AbbSimpleDeadlines | None = None,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        caps = Caps(speed_mm_s, speed_deg_s, limits_deg, joints=JOINTS, widest_deg=_WIDEST_DEG, device=name)
        address = parse_url(url)
        self.name = name
        self._deadlines = deadlines or AbbSimpleDeadlines()
        self._caps = caps
        self._hold_deg = hold_deg
        self._clock = clock
        self._motion = MotionServer(TcpLink(address, name, wire=wire, clock=clock), self._deadlines)
        behind = beside(address, "state", address.port + 2, name)
        self._stream = StateStream(TcpLink(behind, f"{name}-state", clock=clock), self._deadlines, wire)
        self._lock = threading.RLock()
        self._armed = False
        self._warned = False

    @property
    def deadlines(self) -> AbbSimpleDeadlines:
        """The named waits; may be replaced between questions."""
        return self._deadlines

    @deadlines.setter
    def deadlines(self, deadlines: AbbSimpleDeadlines) -> None:
        self._deadlines = self._stream.deadlines = self._motion.deadlines = deadlines

    # -- connection ---------------------------------------------------------------------------------------

    @property
    def can_stop(self) -> bool:
        """True: the motion server reads a stop while another task moves the robot."""
        return True

    @property
    def weakness(self) -> str:
        """The errors that this protocol cannot detect."""
        return _WEAKNESS

    def connect(self) -> None:
        """Connect to the state and motion servers without moving the robot.

        Waits for one state and for the answer to a stop.

        Raises
        ------
        LinkError
            The connection failed.
        LinkTimeout
            No answer, for example because another client controls the robot: the server accepts and does not answer.
        """
        if not self._warned:
            self._warned = True
            _LOG.warning(
                "%s: this ABB driver is unverified on hardware; no watchdog guards a move", self.name
            )
            _LOG.warning("%s: %s", self.name, self.weakness)
        with self._lock:
            self.disconnect()
            try:
                patiently(self._stream.open, self.deadlines.takeover_s, self._clock)
                self._motion.open()
                self.position()
            except LinkTimeout as error:
                self.disconnect()
                error.what_to_do = _SILENT
                raise
            except BaseException:
                self.disconnect()
                raise

    def disconnect(self) -> None:
        """Close both connections and disarm; never raises."""
        self._armed = False
        self._motion.close()
        self._stream.close()

    def identify(self) -> Identity:
        """Return the identity; simple_message reports no serial number or type.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self.position()
        return Identity("ABB", "", "", "", "simple_message")

    # -- arming -------------------------------------------------------------------------------------------

    def arm(self) -> None:
        """Check the controller; allow motion.

        Raises
        ------
        LinkError
            The connection failed.
        SafetyStop
            The emergency stop is pressed.
        WrongMode
            The controller is not in automatic mode, or its motors are off.
        NotReady
            The motion program does not run.
        Busy
            The robot moves.
        """
        with self._lock:
            raise_if_unfit(self._state_at_rest("arm"), self.name, "arm")
            if not self._motion.is_open:
                raise LinkLost("not connected", device=self.name, command="arm")
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
            The connection failed, and the position of the robot is unknown; it is ordered to stop.
        SafetyStop, WrongMode, MotionStopped
            The robot was stopped on its way.
        NotReached
            The robot is not at its target.
        Busy
            Another program moves the robot.
        """
        target = tuple(float(q) for q in joints_deg)
        self._caps.check(target)
        with self._lock, ExitStack() as undo:
            if not self._armed:
                raise NotArmed("motion without arming", device=self.name, command="move_to")
            undo.callback(self.disarm)  # wherever the robot is now, a person has to check first
            here = self._state_at_rest("move_to")
            raise_if_unfit(here, self.name, "move_to")
            seconds = self._duration(here, target)
            self._motion.say(START, here.joints_rad, here.external, seconds, "move_to")
            undo.callback(self._motion.halt_if_possible)
            goal_rad = [math.radians(q) for q in target]
            self._motion.say(END, goal_rad, here.external, seconds, "move_to")
            reached = self._arrival(here, target, seconds)
            undo.pop_all()
        return _reading(reached)

    def _arrival(self, here: AbbState, target: Sequence[float], seconds: float) -> AbbState:
        """Wait for the state of a robot at the target, confirmed by the state before.

        If the move is shorter than the permitted deviation of a servo, states before it look like its end. The
        predicted time of the move must then pass first.
        """
        begin = self._clock()
        credible = begin + seconds if is_there(_reading(here), target, self._hold_deg) else begin
        end = begin + self.deadlines.move_factor * seconds + self.deadlines.move_margin_s
        rest_since = math.inf
        number, before = self._stream.following(self._stream.count, "move_to")
        while True:
            number, now = self._stream.following(number, "move_to")
            if self._motion.stopped.is_set():
                raise MotionStopped("stopped on its way", device=self.name, command="move_to", raw=now.raw)
            off = apart_deg(now.joints_deg, target)
            if now.flags == before.flags:
                raise_if_unfit(now, self.name, "move_to")
                if _is_at_rest(before, now):
                    rest_since = min(rest_since, self._clock())
                    if is_there(_reading(now), target, self._hold_deg) and self._clock() >= credible:
                        return now
                else:
                    rest_since = math.inf
            before = now
            rested = self._clock() - max(rest_since, credible)
            if rested > self.deadlines.still_s or self._clock() > end:
                limit = "still_s" if rested > self.deadlines.still_s else "move_s"
                raise NotReached(
                    f"{off:.3f} deg from its target, abandoned after {limit}",
                    device=self.name,
                    command="move_to",
                    raw=now.raw,
                )

    def position(self) -> JointReading:
        """Return the joint angles from three consecutive states that agree.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            The robot is still moving.
        """
        return _reading(self._state_at_rest("position"))

    def _state_at_rest(self, command: str) -> AbbState:
        return self._confirmed(command, _is_at_rest)

    def _confirmed(self, command: str, good: Callable[[AbbState, AbbState], bool]) -> AbbState:
        """Return the last of three consecutive states that agree.

        Raises
        ------
        LinkError
            The connection failed.
        Busy
            The states do not agree within `settle_s`.
        """
        end = self._clock() + self.deadlines.settle_s
        number, before = self._stream.following(self._stream.count, command)
        alike = 1
        while True:
            number, now = self._stream.following(number, command)
            alike = alike + 1 if now.flags == before.flags and good(before, now) else 1
            if alike == _ALIKE:
                return now
            if self._clock() >= end:
                raise Busy("the robot is still moving", device=self.name, command=command, raw=now.raw)
            before = now

    def stop(self) -> None:
        """Halt the robot now and disarm. From any thread.

        Raises
        ------
        LinkError
            The stop was not answered.
        """
        self._armed = False
        self._motion.stopped.set()
        self._motion.halt()

    def status(self) -> RobotStatus:
        """Return the state of the controller.

        Raises
        ------
        LinkError
            The connection failed.
        """
        now = self._confirmed("status", lambda before, now: True)
        flags = now.flags
        return RobotStatus(
            flags.mode,
            flags.motors_on,
            flags.emergency_stop,
            flags.moving,
            flags.error_code if flags.in_error else None,
            now.raw,
        )

    # -- checks -------------------------------------------------------------------------------------------

    def _duration(self, here: AbbState, target: Sequence[float]) -> float:
        """Compute the shortest duration of a move, s, within the speed limits of joints and tool."""
        turns = [abs(a - b) for a, b in zip(here.joints_deg, target, strict=True)]
        return self._caps.seconds(turns) + _RAMP_S


def _is_at_rest(before: AbbState, now: AbbState) -> bool:
    """Check whether two consecutive states show a robot at rest."""
    external = zip(before.external, now.external, strict=True)
    return (
        now.flags.moving is False
        and apart_deg(before.joints_deg, now.joints_deg) <= _AGREE_DEG
        and all(math.isclose(a, b, rel_tol=1e-6, abs_tol=_AGREE_M) for a, b in external)
    )


def _reading(state: AbbState) -> JointReading:
    return JointReading(state.joints_deg, state.resolution_deg, state.raw)
