"""Comparison of commanded and actual motion of the robot.

Targets are shown back before a move, and read back to their resolution after it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Sequence

import pytest

from drivers import (
    AbbArm,
    AbbDeadlines,
    AbbSimpleArm,
    AbbSimpleDeadlines,
    FanucArm,
    FanucDeadlines,
    LinkError,
    MotionStopped,
    NotReached,
    ProtocolError,
    RobotArm,
    UrArm,
    UrDeadlines,
    open_robot,
)
from drivers.interfaces import weakness_of
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.expected import CALSRV_BACKGROUND, CALSRV_MAIN, ExpectedDevice, Pair

TARGET = (10.0, 20.0, -30.0, 5.0, 45.0, 60.0)
ABB = AbbDeadlines(settle_s=0.05, gap_s=0.01)
SIMPLE = AbbSimpleDeadlines(still_s=0.05)
FANUC = FanucDeadlines(settle_s=0.05, gap_s=0.001)
UR = UrDeadlines(settle_s=0.1, start_s=0.5)


def abb(cell: CellThread) -> RobotArm:
    return AbbArm(cell.url("abb"), deadlines=ABB)


def abb_simple(cell: CellThread) -> RobotArm:
    return AbbSimpleArm(cell.url("abb-simple"), deadlines=SIMPLE)


def fanuc(cell: CellThread, options: str = "") -> RobotArm:
    address = f"{cell.url('fanuc')}?logger={cell.port('fanuc-logger')}"
    if options:
        address = f"{cell.url(f'fanuc-modbus-{options}')}?modbus={options}"
    return FanucArm(address, deadlines=FANUC)


def rmi(cell: CellThread) -> RobotArm:
    return open_robot("fanuc-rmi", cell.url("fanuc-rmi"), deadlines=FANUC)


def ur(cell: CellThread, feed: str = "rtde") -> RobotArm:
    return UrArm(f"{cell.url('ur')}?feed={feed}", deadlines=UR)


# Arm, device of the cell, robot, stock server, and by how much a joint may be elsewhere unseen (deg).
ARMS: dict[str, tuple[Callable[[CellThread], RobotArm], str, str, bool, float]] = {
    "abb-calsrv": (abb, "abb", "abb-irb120", False, 0.002),
    "abb-stock": (abb, "abb", "abb-irb120", True, 0.007),
    "abb-simple": (abb_simple, "abb-simple", "abb-irb120", False, 0.002),
    "fanuc-cal": (fanuc, "fanuc", "fanuc-lrmate200ic", False, 0.0035),
    "fanuc-stock": (fanuc, "fanuc", "fanuc-lrmate200ic", True, 0.0035),
    "fanuc-hmi": (lambda cell: fanuc(cell, "hmi"), "fanuc", "fanuc-lrmate200ic", False, 0.003),
    "fanuc-io": (lambda cell: fanuc(cell, "io"), "fanuc", "fanuc-lrmate200ic", False, 0.003),
    "fanuc-rmi": (rmi, "fanuc-rmi", "fanuc-lrmate200ic", False, 0.0035),
    "ur-rtde": (ur, "ur", "ur5", False, 0.0006),
    "ur-30003": (lambda cell: ur(cell, "realtime"), "ur", "ur5", False, 0.0006),
}
CONFIRMED = {"abb-calsrv", "fanuc-cal", "fanuc-hmi", "fanuc-io", "ur-rtde"}


def lead_astray(cell: CellThread, by_deg: float) -> None:
    """Offset the end of all further motions of joint 1 of the simulated arm."""
    assert cell.cell is not None
    arm = cell.cell.arm
    start = arm.start

    def elsewhere(target: Sequence[float], rate_deg_s: float, tool_mm_s: float) -> None:
        start((target[0] + by_deg, *target[1:]), rate_deg_s, tool_mm_s)

    arm.start = elsewhere


@pytest.mark.parametrize("name", list(ARMS))
def test_a_joint_that_is_elsewhere_by_more_than_the_wire_can_hide_is_not_there(name: str) -> None:
    make, device, robot, stock, hidden_deg = ARMS[name]
    file = CellFile(robot=robot, time_scale=10_000.0, effects=("none",))
    with CellThread(file, stock=stock, devices=(device,)) as cell:
        arm = make(cell)
        arm.connect()
        arm.arm()
        assert arm.move_to(TARGET).joints_deg == pytest.approx(TARGET, abs=hidden_deg)
        lead_astray(cell, 1.6 * hidden_deg)
        with pytest.raises((NotReached, MotionStopped)):
            arm.move_to((*TARGET[:5], 61.0))
        arm.disconnect()


@pytest.mark.parametrize("name", list(ARMS))
def test_who_moves_on_one_request_says_so(name: str, caplog: pytest.LogCaptureFixture) -> None:
    make, device, robot, stock, _ = ARMS[name]
    file = CellFile(robot=robot, time_scale=10_000.0, effects=("none",))
    with CellThread(file, stock=stock, devices=(device,)) as cell, caplog.at_level(logging.WARNING):
        arm = make(cell)
        arm.connect()
        arm.connect()
        weakness = weakness_of(arm)
        arm.disconnect()
    warnings = sum("damaged on its way" in record.message for record in caplog.records)
    assert (bool(weakness), warnings) == ((False, 0) if name in CONFIRMED else (True, 1))


# -- the answer shows another target: no go is sent ------------------------------------------------------------


def changed(pairs: list[Pair], request: bytes, old: bytes, new: bytes) -> list[Pair]:
    """The conversation up to this request, with something else in its answer."""
    at = next(i for i, pair in enumerate(pairs) if pair[0].startswith(request))
    answer = pairs[at][1].replace(old, new)
    assert answer != pairs[at][1]
    return [*pairs[:at], (pairs[at][0], answer)]


def test_calsrv_shows_another_target() -> None:
    other = changed(CALSRV_MAIN, b"201 ", b" 90.00000", b" 90.10000")
    with ExpectedDevice(other) as main, ExpectedDevice(CALSRV_BACKGROUND[:2]) as back:
        arm = AbbArm(f"tcp://127.0.0.1:{main.port}?background={back.port}")
        arm.connect()
        arm.arm()
        with pytest.raises(ProtocolError, match="understood another request; nothing moved"):
            arm.move_to((10.12345, -5.0, 0.0, 0.0, 0.0, 90.0))
        arm.disconnect()


@pytest.mark.parametrize(("old", "new"), [(b" 2000 ", b" 9000 "), (b" 20.0 ", b" 90.0 "), (b" 500.0", b"")])
def test_calsrv_shows_other_conditions(old: bytes, new: bytes) -> None:
    other = changed(CALSRV_MAIN, b"208 ", old, new)
    with ExpectedDevice(other) as main, ExpectedDevice(CALSRV_BACKGROUND[:2]) as back:
        arm = AbbArm(f"tcp://127.0.0.1:{main.port}?background={back.port}")
        arm.connect()
        with pytest.raises(ProtocolError, match="understood another request"):
            arm.arm()
        arm.disconnect()


@pytest.mark.parametrize("profile", ["hmi", "io"])
@pytest.mark.parametrize("version", [0, 1, 3])
def test_another_modbus_program_is_refused_by_its_version(profile: str, version: int) -> None:
    file = CellFile(robot="fanuc-lrmate200ic", time_scale=10_000.0, effects=("none",))
    with CellThread(file, devices=("fanuc",)) as cell:
        assert cell.cell is not None
        image = cell.cell.fanuc.modbus[f"fanuc-modbus-{profile}"][1].image
        image.version = version  # type: ignore[attr-defined]
        arm = fanuc(cell, profile)
        arm.connect()
        with pytest.raises(LinkError, match=f"program version {version}, needed 2"):
            arm.arm()
        arm.disconnect()


@pytest.mark.parametrize("feed", ["rtde", "realtime"])
def test_a_ur_that_does_not_hold_its_target_is_not_there(feed: str) -> None:
    """The controller's own target is right; a joint is 0.02 deg away from it."""
    with CellThread(CellFile(robot="ur5", time_scale=10_000.0, effects=("none",)), devices=("ur",)) as cell:
        assert cell.cell is not None
        servo = cell.cell.ur.servo
        held = servo.actual
        servo.actual = lambda: (held()[0] + math.radians(0.02), *held()[1:])
        arm = ur(cell, feed)
        arm.connect()
        arm.arm()
        with pytest.raises(NotReached, match="deg from where it was sent"):
            arm.move_to(TARGET)
        arm.disconnect()
