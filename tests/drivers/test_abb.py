"""The ABB driver against the simulated controller: motion, stop, modes, limits, a second client."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from drivers import AbbArm, AbbDeadlines, EmergencyStop, LinkTimeout, ProtectiveStop
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.waiting import PATIENCE_S, under_way, until

FAR = (90.0, 60.0, 30.0, 40.0, 50.0, 60.0)
FAST = CellFile(time_scale=10_000.0, effects=("none",))
ROBOT, DEVICES = "abb-irb120", ("abb", "faro")
HASTY = AbbDeadlines(ping_s=0.4, move_margin_s=0.3, move_factor=0.01)


def connected(cell: CellThread, **options: Any) -> AbbArm:
    arm = AbbArm(cell.url("abb"), **options)
    arm.connect()
    return arm


@pytest.fixture
def stock() -> Iterator[CellThread]:
    with CellThread(FAST, stock=True) as cell:
        yield cell


def test_sides_of_approach_follow_the_last_motion_of_each_joint(fast: CellThread) -> None:
    arm = connected(fast)
    arm.arm()
    arm.move_to((-5.0, 5.0, 5.0, 5.0, 5.0, 5.0))
    arm.move_to((-5.0, 0.0, 10.0, 10.0, 10.0, 10.0))
    state = fast.do("state")
    assert state["sides"] == (-1, -1, 1, 1, 1, 1)
    assert state["previous_deg"] == (-5.0, 5.0, 5.0, 5.0, 5.0, 5.0)
    arm.disconnect()


def test_stop_is_repeated_on_a_fresh_connection(fast: CellThread) -> None:
    arm = connected(fast)
    arm._back.link.close()  # the background connection was lost
    arm.stop()
    arm.disconnect()


def test_connect_names_an_emergency_stop_that_silenced_the_program(fast: CellThread) -> None:
    arm = connected(fast)
    fast.do("estop")
    arm.deadlines = HASTY
    with pytest.raises(EmergencyStop) as caught:
        arm.connect()
    assert caught.value.code == 4001


def test_watchdog_stops_the_robot_when_the_program_is_gone(slow: CellThread) -> None:
    arm = connected(slow, watchdog_s=0.3)
    arm.arm()
    under_way(arm, FAR, slow)
    arm.disconnect()
    until(lambda: not slow.do("state")["moving"])
    assert max(slow.do("state")["joints_deg"]) < 60.0


def test_controller_stops_by_itself(slow: CellThread) -> None:
    """T_ROB1 reports that it was stopped; neither an emergency stop nor a stop of ours was the reason."""
    arm = connected(slow)
    arm.arm()
    move = under_way(arm, FAR, slow)
    assert slow.cell is not None
    slow.cell.abb._watchdog_acted = True
    slow.cell.arm.halt()
    assert slow.cell is not None
    slow.do("motors", on=True)  # wakes the task in its own loop
    with pytest.raises(ProtectiveStop):
        move.result(PATIENCE_S)
    arm.disconnect()


def test_old_server_that_loses_the_first_answer(stock: CellThread) -> None:
    stock.do("lose_first_reply", on=True)
    arm = AbbArm(stock.url("abb"))
    arm.connect()
    arm.disconnect()


def test_stock_emergency_stop_is_a_missing_answer_and_a_log_that_goes_on(stock: CellThread) -> None:
    arm = connected(stock)
    arm.arm()
    stock.do("estop")
    arm.deadlines = HASTY
    with pytest.raises(ProtectiveStop) as caught:
        arm.move_to(FAR)
    assert isinstance(caught.value.__cause__, LinkTimeout)
    stock.do("restart")
    arm.deadlines = AbbDeadlines()
    arm.connect()
    arm.arm()
    arm.move_to(FAR)
    arm.disconnect()


def test_stock_silence_without_a_log_is_a_dead_link(stock: CellThread) -> None:
    arm = connected(stock)
    arm.arm()
    stock.do("supervise")
    arm.deadlines = HASTY
    arm._back.link.address = replace(arm._back.link.address, port=1)
    with pytest.raises(LinkTimeout, match="move_s"):
        arm.move_to(FAR)
    arm.disconnect()


def test_stock_reads_back_rounded_and_moves_exactly(stock: CellThread) -> None:
    arm = connected(stock)
    arm.arm()
    reached = arm.move_to((10.1234, 0, 0, 0, 0, 0))
    assert reached.joints_deg[0] == 10.12
    assert stock.do("state")["joints_deg"][0] == 10.1234
    arm.disconnect()
