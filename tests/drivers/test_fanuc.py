"""The Fanuc driver on the simulated controller, over all of its wires.

Motion, stop, alarms, limits, clients.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace

import pytest

from drivers import (
    AcquisitionError,
    Busy,
    CommandRefused,
    FanucArm,
    LinkLost,
    NotReady,
    ProtocolError,
)
from mocks.cell import CellThread
from tests.drivers.fanuc_cells import FAR, FAST, QUICK, SLOW, WIRES, arm_of, cell_of
from tests.drivers.waiting import PATIENCE_S, in_thread, under_way, until

POSE = (12.5, 20.0, -31.25, 40.0, -45.0, 60.1234)
POSE_OF_MODEL = (12.5, 20.0, 11.25, -40.0, 45.0, -60.1234)  # theta = (J1, J2, -(J2 + J3), -J4, -J5, -J6)
STOPPABLE = ["mappdk-cal", "modbus-hmi", "modbus-io"]


@pytest.fixture(params=list(WIRES))
def wire(request: pytest.FixtureRequest) -> str:
    return request.param


@pytest.fixture
def fast(wire: str) -> Iterator[tuple[CellThread, FanucArm]]:
    with cell_of(wire, FAST) as cell:
        arm = arm_of(wire, cell)
        arm.connect()
        yield cell, arm
        arm.disconnect()


@pytest.fixture
def slow(wire: str) -> Iterator[tuple[CellThread, FanucArm]]:
    with cell_of(wire, SLOW) as cell:
        arm = arm_of(wire, cell, speed_deg_s=4.0)  # a busy machine does not sleep through the way to FAR
        arm.connect()
        arm.arm()
        yield cell, arm
        arm.disconnect()


# -- every wire ----------------------------------------------------------------------------------------------


def test_angles_are_the_controllers(fast: tuple[CellThread, FanucArm]) -> None:
    """Joint 3 is counted from the horizontal: the arm of the model turns by other angles."""
    cell, arm = fast
    arm.arm()
    reached = arm.move_to(POSE)
    assert reached.joints_deg == pytest.approx(POSE, abs=reached.resolution_deg)
    assert arm.position().joints_deg == pytest.approx(POSE, abs=reached.resolution_deg)
    assert cell.do("state")["joints_deg"] == pytest.approx(POSE_OF_MODEL, abs=reached.resolution_deg)
    assert reached.raw


@pytest.mark.parametrize("wire", STOPPABLE)
def test_stop_on_a_lost_connection_opens_a_fresh_one(fast: tuple[CellThread, FanucArm]) -> None:
    _, arm = fast
    arm.arm()
    controller = arm._controller
    controller._logger.link.close() if arm.dialect == "mappdk-cal" else controller.close()  # type: ignore[attr-defined]
    arm.stop()


@pytest.mark.parametrize("wire", STOPPABLE)
def test_watchdog_stops_the_robot_when_the_program_is_gone(slow: tuple[CellThread, FanucArm]) -> None:
    cell, arm = slow
    under_way(arm, FAR, cell)
    assert cell.cell is not None
    cell.cell.fanuc.controller.beat_s = 0.3
    arm.disconnect()
    until(lambda: not cell.do("state")["moving"])
    assert max(cell.do("state")["joints_deg"]) < 60.0


def test_position_of_a_robot_that_goes_on_moving(slow: tuple[CellThread, FanucArm]) -> None:
    cell, arm = slow
    assert cell.cell is not None
    creeping_deg_s = 1.0  # between two answers in a row that is less than the resolution of some wires
    cell.cell.arm.start((90.0, 0.0, 0.0, 0.0, 0.0, 0.0), rate_deg_s=creeping_deg_s, tool_mm_s=1e9)
    arm.deadlines = replace(QUICK, settle_s=0.1, gap_s=0.01)
    with pytest.raises(Busy):
        arm.position()
    cell.cell.arm.halt()
    assert arm.position().joints_deg[0] > 0.0


@pytest.mark.parametrize("speed", [(500.0, 20.0), (100.0, 20.0), (500.0, 5.0)])
@pytest.mark.parametrize(
    "target", [(90.0, 0, 0, 0, 0, 0), (0, 0, 0, 0, 0, 180.0), (9.0, 60.0, -30.0, 7, 50, 90)]
)
def test_speed_keeps_both_caps(speed: tuple[float, float], target: tuple[float, ...]) -> None:
    """Speed is in whole percent of the joints' speeds, at least 1 %.

    It is as fast as the caps allow, and never faster.
    """
    with cell_of("modbus-hmi", FAST) as cell:
        arm = arm_of("modbus-hmi", cell, speed_mm_s=speed[0], speed_deg_s=speed[1])
        arm.connect()
        arm.arm()
        arm.move_to(target)
        arm.disconnect()
        assert cell.cell is not None
        percent = cell.cell.fanuc.modbus["fanuc-modbus-hmi"][1].image.read(60)
    top = (350.0, 350.0, 400.0, 450.0, 450.0, 720.0)
    lever = (1000.0, 1000.0, 1000.0, 400.0, 400.0, 400.0)

    def rates(percent: int) -> tuple[float, float]:
        seconds = max(abs(q) / v for q, v in zip(target, top, strict=True)) / (percent / 100)
        path = sum(math.radians(abs(q)) * arm for q, arm in zip(target, lever, strict=True))
        return path / seconds, max(map(abs, target)) / seconds

    assert percent == 1 or all(rate <= cap for rate, cap in zip(rates(percent), speed, strict=True))
    assert any(rate > cap for rate, cap in zip(rates(percent + 1), speed, strict=True))


# -- Modbus --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("wire", ["modbus-hmi", "modbus-io"])
def test_stale_done_is_never_believed(fast: tuple[CellThread, FanucArm]) -> None:
    """The robot still shows the number that would come next, as done: another number is taken."""
    cell, arm = fast
    arm.arm()
    arm.move_to(POSE)
    assert cell.cell is not None
    image = cell.cell.fanuc.modbus[f"fanuc-{arm.dialect}"][1].image
    last = image.done  # type: ignore[attr-defined]
    image.done = last + 1  # type: ignore[attr-defined]
    arm.connect()
    arm.arm()
    arm.move_to((0.0,) * 6)
    assert image.done == last + 2  # type: ignore[attr-defined]
    assert cell.do("state")["joints_deg"] == pytest.approx((0.0,) * 6, abs=1e-4)


@pytest.mark.parametrize("wire", ["modbus-hmi", "modbus-io"])
def test_numbers_begin_again_after_the_last(fast: tuple[CellThread, FanucArm]) -> None:
    _, arm = fast
    arm.arm()
    arm._controller._number = arm._controller._profile.last_number  # type: ignore[attr-defined]
    arm.move_to(POSE)
    arm.move_to(FAR)
    assert arm._controller._number == 2  # type: ignore[attr-defined]


@pytest.mark.parametrize("wire", ["modbus-hmi", "modbus-io"])
def test_two_clients_do_not_share_a_robot(slow: tuple[CellThread, FanucArm], wire: str) -> None:
    cell, arm = slow
    other = arm_of(wire, cell, deadlines=replace(QUICK, settle_s=0.1))
    move = in_thread(lambda: arm.move_to(FAR))
    assert cell.cell is not None
    joints = cell.cell.fanuc.controller.joints_deg
    until(lambda: max(map(abs, joints())) > 1.0)  # at the very beginning two readings may still agree
    with pytest.raises(Busy):
        other.connect()  # no position while it moves
    other.deadlines = QUICK
    other._controller.open()
    with pytest.raises(Busy, match="under way"):
        other._controller.prepare()
    controller = other._controller
    with suppress(
        NotReady
    ):  # what the first client writes as it halts may be read back in place of one's own
        controller._profile.command(controller._registers, POSE, 1, 99)  # type: ignore[attr-defined]
    with pytest.raises(Busy, match="another client"):
        move.result(PATIENCE_S)
    other.disconnect()


def test_fifth_client_drops_the_one_silent_for_longest() -> None:
    with cell_of("modbus-hmi", FAST) as cell:
        arms = [arm_of("modbus-hmi", cell) for _ in range(5)]
        for arm in arms:
            arm.connect()
        with pytest.raises(LinkLost):
            arms[0].position()
        arms[1].position()
        for arm in arms:
            arm.disconnect()


@pytest.mark.parametrize(
    ("options", "error"),
    [
        ("?modbus=io&outputs=200", NotReady),  # nothing there: reads 0
        ("?modbus=io&inputs=300", NotReady),  # swallows what is written
        ("?modbus=hmi", ProtocolError),  # no register assignment: no valid joints
    ],
)
def test_wrong_registers(options: str, error: type[AcquisitionError]) -> None:
    with cell_of("modbus-io", FAST) as cell:
        arm = FanucArm(cell.url("fanuc-modbus-io") + options, deadlines=QUICK)
        with pytest.raises(error):  # noqa: PT012 - at the latest when it is to move
            arm.connect()
            arm.arm()
            arm.move_to(POSE)
        arm.disconnect()


def test_modbus_exception_is_a_refusal() -> None:
    with cell_of("modbus-hmi", FAST) as cell:
        arm = arm_of("modbus-hmi", cell)
        arm.connect()
        registers = arm._controller._registers  # type: ignore[attr-defined]
        with pytest.raises(CommandRefused, match="exception 1"):
            registers._ask("odd", lambda: registers._wire.report_device_id())
        arm.position()
        arm.disconnect()


def test_program_that_does_not_run() -> None:
    with cell_of("modbus-hmi", FAST) as cell:
        arm = arm_of("modbus-hmi", cell)
        arm.connect()
        assert cell.cell is not None
        image = cell.cell.fanuc.modbus["fanuc-modbus-hmi"][1].image
        read = image.read
        image.read = lambda address: 0 if address == 109 else read(address)
        with pytest.raises(NotReady, match="CALHMI"):
            arm.arm()
        arm.disconnect()


def test_slower_robot_by_the_address() -> None:
    arm = FanucArm("tcp://h:18735?max_deg_s=100,100,100,100,100,100")
    assert arm._pace((90.0, 0, 0, 0, 0, 0))[0] == 20
