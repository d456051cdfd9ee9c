"""Connect, arm and disarm the robot and the instrument for the sequencer.

After a `LinkError`, the device is connected and armed again; any error of a commanded robot disarms it. A device is
armed only for the move to an approach point, so that nothing moves without one.

Controllers may report the end of a move before the arm has come to rest. The settle check therefore waits until two
consecutive read-backs agree within the resolution of the reply.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from typing import cast

from acquisition.cell.devices import Devices, ManualJogging
from acquisition.run.orders.control import Control
from acquisition.run.rig.device_state import DeviceCondition, DeviceStates
from drivers.errors import AcquisitionError, LinkError, LinkLost, NoisyMeasurement, Unmeasurable
from drivers.interfaces import (
    Asking,
    Device,
    HandGuided,
    Identity,
    JointReading,
    LengthMeter,
    LengthReading,
    OperatedByPerson,
    PointMeter,
    PointReading,
    RobotArm,
    Sample,
    SpeedLimited,
    Streaming,
    weakness_of,
)

PRESS = "Press the emergency stop: the program does not reach the robot, which may still be moving."

EVERY_S = 0.5  # campaign time between two read-backs; an arm swings at some hertz

TRIES = 20


@dataclass(frozen=True)
class ConnectedDevice:
    """A device that has just been connected.

    Attributes
    ----------
    read_deg
        Joint angles of the robot; None for the instrument.
    weakness
        Errors that its protocol cannot detect; see `drivers.interfaces.ReportsWeakness`.
    """

    role: str
    who: Identity
    can_stop: bool
    read_deg: tuple[float, ...] | None
    weakness: str


class DevicePair:
    """The devices of one execution.

    `met` is called after each connection, before anything moves; `states` notes what is known of both.
    """

    def __init__(
        self,
        devices: Devices,
        control: Control,
        met: Callable[[ConnectedDevice], None],
        states: DeviceStates | None = None,
    ) -> None:
        self._devices = devices
        self._control = control
        self._met = met
        self.states = states or DeviceStates(time.time, lambda known: None)
        self._connected: set[str] = set()
        self._armed: set[str] = set()
        self._seen: set[str] = set()  # connected at least once
        self._lost: set[str] = set()  # its link broke, or could not be made, and is not there again
        self._can_stop = True
        self._at_rest = False  # since its last move nothing happened that may have set it moving
        self.moving = False
        self.lost_in_move = False
        self.adrift = False  # its link broke in a move, and it has not been seen at rest since
        self.unheard: list[AcquisitionError] = []  # devices that the last halt did not stop
        self._halting = threading.Condition()
        self._halts = 0  # under way
        self._released = False
        self._endings = 0  # requests to end the connections that are not yet carried out

    def meet(self) -> None:
        """Connect the devices that are not connected, without arming them.

        Raises
        ------
        AcquisitionError
            A device failed, or is another one.
        Stopping
            A stop was requested.
        """
        for role, device in self._both():
            with self.using(role):
                if role not in self._connected:
                    self.states.note(role, DeviceCondition.CONNECTING, "It is being connected.")
                    device.connect()
                    read_deg = None
                    if role == "robot":
                        self._can_stop = self._devices.robot.can_stop
                        read_deg = self._devices.robot.position().joints_deg
                    self._met(
                        ConnectedDevice(
                            role, device.identify(), self._can_stop, read_deg, weakness_of(device)
                        )
                    )
                    self._connected.add(role)  # who it is is known: only then
                    self._seen.add(role)
                    self._lost.discard(role)
                    self.states.note(role, DeviceCondition.READY, "It is connected.")
            self._control.check_stop()

    def look(self) -> None:
        """Check that both devices still answer.

        Their status is not judged here; it is judged when they are armed. Errors are those of `meet`, and:

        Raises
        ------
        LinkError
            A device does not answer.
        """
        self.meet()
        robot, instrument = self._devices.robot, self._devices.instrument
        for role, status in (("robot", robot.status), ("instrument", instrument.status)):
            try:
                with self.using(role):
                    status()
            except LinkError:
                raise
            except AcquisitionError:
                continue  # an open gate ends no warm-up

    def make_ready(self) -> None:
        """Connect and arm the devices that are not ready.

        Raises
        ------
        AcquisitionError
            A device failed, or refuses to be armed.
        Stopping
            A stop was requested.
        """
        self.meet()
        for role, device in self._both():
            with self.using(role):
                if role not in self._armed:
                    device.arm()
                    self._armed.add(role)
                    self.states.note(role, DeviceCondition.READY, "It is connected and armed.")
            # A stop between the look before and the arming must not be undone by it.
            self._control.check_stop()

    def _both(self) -> tuple[tuple[str, Device], ...]:
        return ("robot", self._devices.robot), ("instrument", self._devices.instrument)

    def move(self, joints_deg: Sequence[float]) -> JointReading:
        """Move the robot to these joints and wait until it is at rest.

        Raises
        ------
        AcquisitionError
            The move failed.
        Stopping
            A stop was requested.
        """
        return self._driven(lambda: self._devices.robot.move_to(joints_deg))

    def _driven(self, move: Callable[[], JointReading]) -> JointReading:
        self._control.check_stop()
        self.lost_in_move = False
        self._at_rest = False
        with self.using("robot"):
            self.moving = True
            self.states.note("robot", DeviceCondition.MOVING, "It moves.")
            try:
                reached = move()
            except LinkError:
                # A robot that cannot be stopped may still be moving: only a person may decide to continue.
                self.lost_in_move = not self._can_stop
                self.adrift = True
                raise
            finally:
                self.moving = False
        self.adrift = False
        self.states.note("robot", DeviceCondition.READY, "It is at rest.")
        self._control.check_stop()
        self._at_rest = True
        return reached

    def go(self, path_deg: Sequence[Sequence[float]], joints_deg: Sequence[float]) -> JointReading:
        """Move over postures to the last one and come to rest there.

        A prompt shows a person the whole path.

        Raises
        ------
        AcquisitionError
            The move failed.
        Stopping
            A stop was requested.
        """
        robot = self._devices.robot
        if isinstance(robot, HandGuided):
            return self._driven(lambda: robot.move_over(path_deg, joints_deg))
        for each in path_deg:
            self.move(each)
        return self.move(joints_deg)

    def attend(self, ask: Asking) -> None:
        """Let manual devices put their questions to a person through `ask`."""
        for _, device in self._both():
            if isinstance(device, OperatedByPerson):
                device.attend(ask)

    def joints_at_rest_deg(self) -> tuple[float, ...]:
        """Return the present joint angles, deg; wait for a robot that may be moving.

        Raises
        ------
        AcquisitionError
            The robot failed, or does not come to rest.
        Stopping
            A stop was requested.
        """
        if self._at_rest:
            return self.position().joints_deg
        return self.at_rest().joints_deg

    def let_go(self) -> None:
        """Connect the robot and disarm it, so that a person can jog it.

        Raises
        ------
        AcquisitionError
            The robot failed.
        Stopping
            A stop was requested.
        """
        self.meet()
        with self.using("robot"):
            self._devices.robot.disarm()
        self._armed.discard("robot")
        self._at_rest = False

    @property
    def hands(self) -> ManualJogging | None:
        """The simulated person who jogs the arm of a simulated cell."""
        return self._devices.hands

    def at_rest(self) -> JointReading:
        """Return the joints that the robot reads back once it has come to rest.

        Raises
        ------
        AcquisitionError
            The robot failed, or does not come to rest.
        Stopping
            A stop was requested.
        """
        reading = until_still(self.position, self._control.settle)
        self.adrift = False
        return reading

    def may_have_moved(self) -> None:
        """Note that a person may have jogged the robot, or may be near it."""
        self._at_rest = False

    def position(self) -> JointReading:
        """Return the joint angles that the robot reads back.

        Raises
        ------
        AcquisitionError
            The robot failed.
        """
        with self.using("robot"):
            return self._devices.robot.position()

    def measure(self, target: str, samples: int, near_mm: Sequence[float] | None) -> PointReading:
        """Make a complete measurement of a point.

        Raises
        ------
        AcquisitionError
            The measurement failed.
        Stopping
            A stop was requested.
        """
        self._control.check_stop()
        meter = cast(PointMeter, self._devices.instrument)  # of a cell that measures points
        with self._measuring(target):
            return meter.measure(target, samples=samples, near_mm=near_mm)

    def measure_length(self, target: str, base_target: str, samples: int) -> LengthReading:
        """Make a complete measurement of a distance.

        Raises
        ------
        AcquisitionError
            The measurement failed.
        Stopping
            A stop was requested.
        """
        self._control.check_stop()
        with self._measuring(f"from {base_target} to {target}"):
            return self._length_meter.measure(target, base_target=base_target, samples=samples)

    def build(self, nominal_mm: float) -> None:
        """Note that the ballbar has been built to another length.

        It is disarmed; arming it again compares the length with its calibration.
        """
        self._length_meter.build(nominal_mm)
        self._armed.discard("instrument")

    def zero(self) -> float:
        """Read the sensor's zero, mm, while it is in its calibrator.

        Raises
        ------
        AcquisitionError
            The reading failed.
        Stopping
            A stop was requested.
        """
        self._control.check_stop()
        with self._measuring("its zero"):
            return self._length_meter.zero()

    def stream(self, role: str, rate_hz: float) -> AbstractContextManager[Iterator[Sample | None]]:
        """Return the stream of one device.

        Its errors must be raised within `using`, by the thread that commands.
        """
        if role == "instrument":  # of the robot its moves are told
            self.states.note(role, DeviceCondition.MEASURING, "It measures along a path.")
        return cast(Streaming, dict(self._both())[role]).stream(rate_hz)

    def at_speed(self, speed_deg_s: float | None) -> AbstractContextManager[None]:
        """Limit the speed of the leading joint until the block ends.

        With None, the limit is that of the cell.
        """
        return (
            nullcontext()
            if speed_deg_s is None
            else cast(SpeedLimited, self._devices.robot).at_speed(speed_deg_s)
        )

    @property
    def _length_meter(self) -> LengthMeter:
        return cast(LengthMeter, self._devices.instrument)  # of a cell that measures distances

    @contextmanager
    def _measuring(self, what: str) -> Iterator[None]:
        with self.using("instrument"):
            self.states.note("instrument", DeviceCondition.MEASURING, f"It measures {what}.")
            yield
            self.states.note("instrument", DeviceCondition.READY, "It has measured.")

    @contextmanager
    def using(self, role: str) -> Iterator[None]:
        """Track the effect of an error on the connection, the arming and the known state of a device."""
        try:
            yield
            self.states.heard(role)
        except AcquisitionError as error:
            if isinstance(error, LinkError):
                self._lost.add(role)
                self._connected.discard(role)
            if not isinstance(error, Unmeasurable):
                self._armed.discard(role)
                self._at_rest = False
            self.states.failed(role, error, stopped=self._control.stopping)
            raise

    def halt(self) -> list[AcquisitionError]:
        """Stop robot and instrument now, from any thread.

        Returns the errors of devices that could not be stopped and may continue. Both are stopped at the same time: it
        takes seconds until a robot whose link is down is abandoned.
        """
        with self._halting:
            self._halts += 1
        try:
            self.unheard = self._halt()
            return self.unheard
        finally:
            with self._halting:
                self._halts -= 1
                self._halting.notify_all()
                late = self._released
            if late:  # a robot that cannot be reached is connected again to be stopped, and has one place for a program
                self._let_go()

    def _halt(self) -> list[AcquisitionError]:
        problems: list[AcquisitionError] = []
        moving = self.moving or self.adrift
        lost = set(self._lost)

        def stop(role: str, device: RobotArm | PointMeter | LengthMeter) -> None:
            try:
                device.stop()
            except AcquisitionError as error:
                not_reached = isinstance(error, LinkError) and role in self._seen and not self._released
                if moving or not_reached or role in lost:
                    problems.append(_not_stopped(role, error, lost=role in lost))

        beside = threading.Thread(target=stop, args=("instrument", self._devices.instrument))
        beside.start()
        stop("robot", self._devices.robot)
        beside.join()
        return problems

    def release(self) -> None:
        """Disarm and disconnect both, after a stop that is under way.

        The stop uses the same connections.
        """
        with self._halting:
            self._halting.wait_for(lambda: not self._halts)
            self._released = True
        self._let_go()
        self.states.released()

    def _let_go(self) -> None:
        """Disarm and disconnect both.

        If another thread is already doing so, it repeats the work for this one. A stop must not wait for a device that
        is slow to disconnect.
        """
        with self._halting:
            self._endings += 1
            if self._endings > 1:
                return
        while True:
            seen_to = self._endings
            for _, device in self._both():
                # One by one: a device that cannot be disarmed is disconnected all the same.
                with suppress(AcquisitionError):
                    device.disarm()
                with suppress(AcquisitionError):
                    device.disconnect()
            with self._halting:
                if seen_to == self._endings:
                    self._endings = 0
                    return


def _not_stopped(role: str, error: AcquisitionError, *, lost: bool) -> AcquisitionError:
    """Return the error with the action that the person must take now.

    That the program will connect again stops nothing.
    """
    if role != "robot":
        return error
    if isinstance(error, LinkError):
        error.what_to_do = PRESS
        return error
    if not lost:
        return error
    return LinkLost("is not connected, so it did not receive the stop", device=error.device, what_to_do=PRESS)


def until_still(position: Callable[[], JointReading], wait: Callable[[float], None]) -> JointReading:
    """Wait until the arm is at rest and return its read-back.

    Errors of the arguments are passed on.

    Raises
    ------
    NoisyMeasurement
        The arm does not come to rest.
    """
    before, apart = position(), 0.0
    for _ in range(TRIES):
        wait(EVERY_S)
        now = position()
        apart = max(abs(a - b) for a, b in zip(now.joints_deg, before.joints_deg, strict=True))
        if apart <= max(now.resolution_deg, before.resolution_deg):
            return now
        before = now
    raise NoisyMeasurement(
        f"the arm does not come to rest: a joint still moves by {apart:.4f} deg in {EVERY_S:g} s",
        device="robot",
        command="settle check",
    )


def add_unreached_devices(reason: str, unheard: Sequence[AcquisitionError]) -> str:
    """Add the devices that the last stop did not reach to the reason.

    The advice to press the emergency stop comes first. Nothing is repeated.
    """
    remedies = dict.fromkeys(each.what_to_do for each in unheard)
    now = [PRESS] if PRESS in remedies else []
    told = dict.fromkeys(each.what_happened for each in unheard if each.message not in reason)
    others = [each for each in remedies if each != PRESS and each not in reason]
    return " ".join([*now, reason.replace(f" {PRESS}", ""), *told, *others])
