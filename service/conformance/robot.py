"""Promises of a robot driver beyond wire faults: its moves, its stops, and false answers.

A function raises `RequirementFailed` if its promise does not hold.
"""

from __future__ import annotations

import math
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import Future
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from typing import Any

from drivers import (
    AcquisitionError,
    CannotStop,
    ConfigError,
    JointLimit,
    LinkError,
    MotionStopped,
    NotArmed,
    NotReached,
    RobotArm,
    open_robot,
)
from mocks.faultproxy import DatagramProxy, FaultProxy
from service.conformance import common
from service.conformance.bench import RobotBench, SimulatedRobot
from service.conformance.common import DriverRig, RequirementFailed, hold, refused

FAST, SLOW = 1e5, 2.0  # deg/s: at once, and slowly enough for a busy machine to stop it on its way
POSES = 10
FAR_DEG = 60.0
PATIENCE_S = 60.0
# A simulator is another process that answers how its arm is and reports nothing by itself.
_LOOK_AGAIN_S = 0.005


@dataclass
class RobotTrial:
    """A driver on its running simulator."""

    bench: RobotBench
    robot: SimulatedRobot
    stack: ExitStack

    def url(self, port: int) -> str:
        """Return the address of the simulator with this port."""
        return self.bench.url.format(port=port, device=self.robot)

    def arm(self, url: str | None = None, **options: Any) -> Any:
        """Create the driver, not yet connected.

        Raises
        ------
        ConfigError
            The address or an option cannot be used.
        """
        arm = open_robot(
            self.bench.driver, url or self.url(self.robot.port), **{**self.bench.options, **options}
        )
        self.stack.callback(arm.disconnect)
        return arm

    def ready(self, **options: Any) -> Any:
        """Create the driver, connected and armed."""
        arm = self.arm(**options)
        arm.connect()
        arm.arm()
        return arm

    def goal(self, i: int) -> tuple[float, ...]:
        """Return the pose of question i, every joint within 30 deg of zero."""
        return tuple((7 * i + 13 * k) % 59 - 29 + 0.25 for k in range(self.bench.joints))

    def far(self) -> tuple[float, ...]:
        """Return a pose that takes half a minute to reach at the slow pace."""
        return (FAR_DEG,) + (0.0,) * (self.bench.joints - 1)


@contextmanager
def trial(bench: RobotBench) -> Iterator[RobotTrial]:
    """Run the simulator, which moves at once."""
    with ExitStack() as stack:
        robot = stack.enter_context(bench.simulate())
        robot.pace(FAST)
        yield RobotTrial(bench, robot, stack)


@contextmanager
def rig(bench: RobotBench) -> Iterator[DriverRig]:
    """Yield the driver behind a proxy.

    Question i is to go to its own pose, and to read it back.
    """
    with trial(bench) as on:
        orders: dict[str, Callable[..., object]] = {"restart": on.robot.restart, "reboot": on.robot.restart}

        def do(order: str, **values: float) -> object:
            return orders.get(order, lambda **values: None)(**values)

        kind = DatagramProxy if bench.url.startswith("udp:") else FaultProxy
        proxy = on.stack.enter_context(kind(on.robot.port, boundary=bench.end, device=do))
        arm = on.arm(on.url(proxy.port))
        goals: list[tuple[float, ...]] = []

        def ask(i: int) -> float:
            goals.append(on.goal(i))
            reached = arm.move_to(goals[-1]).joints_deg
            read = arm.position().joints_deg
            return max(
                _apart(reached, goals[-1]), _apart(read, goals[-1]), _apart(read, on.robot.joints_deg())
            )

        def elsewhere() -> list[tuple[float, ...]]:
            return [
                tuple(sent)
                for sent in on.robot.targets_deg()
                if all(_apart(sent, goal) > bench.tolerance_deg for goal in goals)
            ]

        yield DriverRig(
            arm,
            proxy,
            do,
            ask,
            bench.tolerance_deg,
            bench.longest_s,
            bench.patient,
            bench.hasty,
            elsewhere,
        )


def has_every_verb(on: RobotTrial) -> None:
    """Check that the driver has the verbs of a robot."""
    arm = on.arm()
    hold(isinstance(arm, RobotArm), "it lacks a verb of drivers.interfaces.RobotArm")
    hold(isinstance(arm.unverified_on_hardware, bool), "unverified_on_hardware is neither True nor False")


def refuses_what_it_cannot_use(on: RobotTrial) -> None:
    """Check that wrong addresses, speeds and limits are refused before anything is opened."""
    common.refuses_wrong_addresses(on.arm)
    refused(ConfigError, "speed_deg_s = 0", partial(on.arm, speed_deg_s=0.0))
    refused(ConfigError, "limits for too many joints", partial(on.arm, limits_deg=[(0.0, 1.0)] * 20))


def nobody_there(on: RobotTrial) -> None:
    """Check that the driver reports that no device answers at its address."""
    common.nobody_there(on.arm, on.url)


def says_who_it_is(on: RobotTrial) -> None:
    """Check that the driver names its robot once connected."""
    arm = on.arm()
    arm.connect()
    common.says_who_it_is(arm)


def nothing_moves_by_itself(on: RobotTrial) -> None:
    """Check that connecting, asking, arming and disconnecting move nothing."""
    before = tuple(on.robot.joints_deg())
    arm = on.arm()
    arm.connect()
    arm.identify()
    arm.position()
    arm.status()
    arm.arm()
    arm.disarm()
    arm.disconnect()
    arm.connect()
    hold(not on.robot.targets_deg(), f"the arm was sent to {_list(on.robot.targets_deg()[:1])}")
    hold(_apart(before, on.robot.joints_deg()) == 0.0, "the arm has moved")


def moves_only_armed(on: RobotTrial) -> None:
    """Check that the driver moves only while it is armed."""
    arm = on.arm()
    move = partial(arm.move_to, on.goal(1))
    arm.connect()
    refused(NotArmed, "a move before arm", move)
    arm.arm()
    arm.disarm()
    refused(NotArmed, "a move after disarm", move)
    arm.arm()
    arm.disconnect()
    refused((NotArmed, LinkError), "a move after disconnect", move)
    arm.connect()
    refused(NotArmed, "a move after a reconnect", move)
    hold(not on.robot.targets_deg(), "the arm was sent somewhere all the same")


def keeps_the_limits(on: RobotTrial) -> None:
    """Check that a wrong target is not sent.

    It is NaN, infinite, beyond a limit, or has too few joints.
    """
    arm = on.ready(limits_deg=[(-90.0, 90.0)] * on.bench.joints)
    rest = (0.0,) * (on.bench.joints - 1)
    for wrong in (math.nan, math.inf, -math.inf, 90.1, -91.0):
        refused(JointLimit, f"{wrong:g} deg", partial(arm.move_to, (*rest, wrong)))
    refused(JointLimit, "a joint too few", partial(arm.move_to, rest))
    hold(not on.robot.targets_deg(), f"the arm was sent to {_list(on.robot.targets_deg()[:1])}")
    arm.move_to((*rest, 89.0))


def arrives(on: RobotTrial) -> None:
    """Check that the pose read back on arrival and afterwards is the true pose of the arm."""
    arm = on.ready()
    for i in range(POSES):
        goal = on.goal(i)
        for reading in (arm.move_to(goal), arm.position()):
            off = max(_apart(reading.joints_deg, goal), _apart(reading.joints_deg, on.robot.joints_deg()))
            hold(off <= on.bench.tolerance_deg, f"pose {i} is read {off:.4g} deg off")
            hold(reading.resolution_deg > 0.0, "the resolution of its reply is not above zero")


def believes_no_false_end(on: RobotTrial) -> None:
    """Check that the driver detects a false end of a move.

    The controller reports the move done at nine tenths of its path.
    """
    arm = on.ready()
    on.robot.fall_short(0.9)
    if on.bench.hasty is not None:
        arm.deadlines = on.bench.hasty
    refused(NotReached, "an end elsewhere", partial(arm.move_to, on.far()))
    refused((NotArmed, LinkError), "the move after it", partial(arm.move_to, on.far()))


def stops(on: RobotTrial) -> None:
    """Check that a stop from another thread halts the robot in mid-move and disarms it."""
    arm = on.ready()
    on.robot.pace(SLOW)
    move = _under_way(on, arm)
    if not arm.can_stop:
        refused(CannotStop, "stop", arm.stop)
        arm.disconnect()
        return
    arm.stop()
    refused(MotionStopped, "the move that was stopped", partial(move.result, PATIENCE_S))
    _wait(lambda: not on.robot.moving(), "the arm still moves")
    hold(on.robot.joints_deg()[0] < 0.9 * FAR_DEG, "the arm went on to its target")
    refused(NotArmed, "a move after the stop", partial(arm.move_to, on.far()))
    on.robot.pace(FAST)
    arm.arm()
    arm.move_to(on.goal(1))


def stops_at_any_time(on: RobotTrial) -> None:
    """Check that a stop before a move, twice, or unconnected gives only errors of the drivers."""
    arm = on.arm()
    common.only_ours("stop without a connection", arm.stop)
    arm.connect()
    arm.arm()
    common.only_ours("stop before any move", arm.stop)
    common.only_ours("stop twice", arm.stop)
    refused(NotArmed, "a move after the stop", partial(arm.move_to, on.goal(1)))


def disconnect_ends_a_move(on: RobotTrial) -> None:
    """Check that a move ends when the driver disconnects."""
    arm = on.ready()
    on.robot.pace(SLOW)
    move = _under_way(on, arm)
    arm.disconnect()
    refused((LinkError, MotionStopped), "the move under way", partial(move.result, PATIENCE_S))


def puts_bytes_on_record(on: RobotTrial) -> None:
    """Check that the driver hands every byte of the wire to its record."""
    heard = common.WireByteCount()
    on.ready(wire=heard).position()
    common.puts_bytes_on_record(heard)


PROMISES: dict[str, Callable[[RobotTrial], None]] = {
    "has every verb of RobotArm": has_every_verb,
    "refuses wrong addresses, speeds and limits": refuses_what_it_cannot_use,
    "says when nobody answers": nobody_there,
    "says who answers; disconnect is final": says_who_it_is,
    "nothing moves before a move is asked for": nothing_moves_by_itself,
    "moves only when armed": moves_only_armed,
    "sends nothing beyond the limits": keeps_the_limits,
    "arrives, and reads back where it is": arrives,
    "believes no false end of a move": believes_no_false_end,
    "stop ends a move under way": stops,
    "stop at any other time": stops_at_any_time,
    "disconnect ends a move under way": disconnect_ends_a_move,
    "puts every byte on record": puts_bytes_on_record,
}


def _apart(one: Sequence[float], other: Sequence[float]) -> float:
    """Return the largest difference of a joint, deg; infinite for unequal numbers of joints."""
    if len(one) != len(other):
        return math.inf
    return max(abs(a - b) for a, b in zip(one, other, strict=True))


def _list(targets: Sequence[Sequence[float]]) -> str:
    return ", ".join("(" + " ".join(f"{q:g}" for q in target) + ")" for target in targets)


def _under_way(on: RobotTrial, arm: RobotArm) -> Future[object]:
    """Begin a move to the far pose in a separate thread."""
    move: Future[object] = Future()

    def run() -> None:
        try:
            move.set_result(arm.move_to(on.far()))
        except AcquisitionError as error:
            move.set_exception(error)

    threading.Thread(target=run, daemon=True).start()
    try:
        _wait(lambda: on.robot.moving() or move.done(), "the move did not begin")
    except RequirementFailed:
        with suppress(AcquisitionError):
            arm.disconnect()
        raise
    hold(not move.done(), "the move ended before it could be stopped")
    return move


def _wait(true: Callable[[], bool], otherwise: str) -> None:
    """Wait until a condition is true.

    Raises
    ------
    RequirementFailed
        It is still false after a minute; the message is `otherwise`.
    """
    end = time.monotonic() + PATIENCE_S
    while not true():
        hold(time.monotonic() < end, otherwise)
        time.sleep(_LOOK_AGAIN_S)
