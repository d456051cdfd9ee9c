"""The ABB driver against the simulated controller: motion, stop, modes, limits, a second client."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import pytest

from drivers import (
    AbbArm,
    AbbDeadlines,
    CannotStop,
    EmergencyStop,
    EnableLost,
    JointLimit,
    LinkError,
    LinkTimeout,
    NotArmed,
    ProtectiveStop,
    WrongMode,
    open_robot,
)
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.waiting import PATIENCE_S, in_thread, until

FAR = (90.0, 60.0, 30.0, 40.0, 50.0, 60.0)
SLOW = CellFile(time_scale=1.0, effects=("none",))  # moves take seconds, for what happens during one
FAST = CellFile(time_scale=10_000.0, effects=("none",))
HASTY = AbbDeadlines(ping_s=0.4, move_margin_s=0.3, move_factor=0.01)


def connected(cell: CellThread, **options: Any) -> AbbArm:
    arm = AbbArm(cell.url("abb"), **options)
    arm.connect()
    return arm


@pytest.fixture
def slow() -> Iterator[CellThread]:
    with CellThread(SLOW) as cell:
        yield cell


@pytest.fixture
def fast() -> Iterator[CellThread]:
    with CellThread(FAST) as cell:
        yield cell


@pytest.fixture
def stock() -> Iterator[CellThread]:
    with CellThread(FAST, stock=True) as cell:
        yield cell


def test_says_what_it_is(fast: CellThread) -> None:
    arm = open_robot("abb", fast.url("abb"))
    arm.connect()
    identity = arm.identify()
    arm.disconnect()
    assert identity.model == "IRB 120-3/0.6"
    assert identity.protocol == "calsrv"


def test_sides_of_approach_follow_the_last_motion_of_each_joint(fast: CellThread) -> None:
    arm = connected(fast)
    arm.arm()
    arm.move_to((-5.0, 5.0, 5.0, 5.0, 5.0, 5.0))
    arm.move_to((-5.0, 0.0, 10.0, 10.0, 10.0, 10.0))
    state = fast.do("state")
    assert state["sides"] == (-1, -1, 1, 1, 1, 1)
    assert state["previous_deg"] == (-5.0, 5.0, 5.0, 5.0, 5.0, 5.0)
    arm.disconnect()


def test_stop_before_any_move_and_twice(fast: CellThread) -> None:
    arm = connected(fast)
    arm.stop()
    arm.stop()
    arm.disconnect()
    with pytest.raises(LinkError):
        AbbArm(fast.url("abb")).position()


def test_stop_is_repeated_on_a_fresh_connection(fast: CellThread) -> None:
    arm = connected(fast)
    arm._back.link.close()  # the background connection was lost
    arm.stop()
    arm.disconnect()


def test_emergency_stop_during_a_move_is_seen_and_never_resumed(slow: CellThread) -> None:
    arm = connected(slow)
    arm.arm()
    move = in_thread(lambda: arm.move_to(FAR))
    until(lambda: slow.do("state")["moving"])
    slow.do("estop")
    with pytest.raises(EmergencyStop) as caught:
        move.result(PATIENCE_S)
    assert caught.value.code == 4001
    arm.deadlines = HASTY
    with pytest.raises(EmergencyStop):
        arm.connect()
    slow.do("restart")
    arm.deadlines = AbbDeadlines()
    arm.connect()
    with pytest.raises(NotArmed):
        arm.move_to(FAR)
    arm.disconnect()


@pytest.mark.parametrize(
    ("order", "error"),
    [({"what": "mode", "mode": "manual"}, WrongMode), ({"what": "motors", "on": False}, EnableLost)],
)
def test_controller_leaves_automatic_during_a_move(
    slow: CellThread, order: dict[str, Any], error: type[Exception]
) -> None:
    arm = connected(slow)
    arm.arm()
    move = in_thread(lambda: arm.move_to(FAR))
    until(lambda: slow.do("state")["moving"])
    slow.do(**order)
    with pytest.raises(error):
        move.result(PATIENCE_S)
    arm.disconnect()


@pytest.mark.parametrize("order", [{"what": "mode", "mode": "manual"}, {"what": "motors", "on": False}])
def test_arm_refuses_a_controller_that_cannot_move(fast: CellThread, order: dict[str, Any]) -> None:
    arm = connected(fast)
    fast.do(**order)
    with pytest.raises(WrongMode):
        arm.arm()
    arm.disconnect()


def test_watchdog_stops_the_robot_when_the_program_is_gone(slow: CellThread) -> None:
    arm = connected(slow, watchdog_s=0.3)
    arm.arm()
    in_thread(lambda: arm.move_to(FAR))
    until(lambda: slow.do("state")["moving"])
    arm.disconnect()
    until(lambda: not slow.do("state")["moving"])
    assert max(slow.do("state")["joints_deg"]) < 60.0


def test_controller_stops_by_itself(slow: CellThread) -> None:
    """T_ROB1 reports that it was stopped; neither an emergency stop nor a stop of ours was the reason."""
    arm = connected(slow)
    arm.arm()
    move = in_thread(lambda: arm.move_to(FAR))
    until(lambda: slow.do("state")["moving"])
    assert slow.cell is not None
    slow.cell.abb._watchdog_acted = True
    slow.cell.arm.halt()
    assert slow.cell is not None
    slow.do("motors", on=True)  # wakes the task in its own loop
    with pytest.raises(ProtectiveStop):
        move.result(PATIENCE_S)
    arm.disconnect()


def test_controller_refuses_its_own_limit_and_nothing_moves(fast: CellThread) -> None:
    arm = connected(fast)
    arm.arm()
    with pytest.raises(JointLimit):
        arm.move_to((170.0, 0, 0, 0, 0, 0))
    assert fast.do("state")["joints_deg"] == (0.0,) * 6
    arm.disconnect()


def test_second_client_is_refused(fast: CellThread) -> None:
    first = connected(fast)
    second = AbbArm(fast.url("abb"), deadlines=HASTY)
    with pytest.raises(LinkTimeout) as caught:
        second.connect()
    assert "no other program" in caught.value.what_to_do
    first.disconnect()
    second.deadlines = AbbDeadlines()
    second.connect()
    second.disconnect()


def test_old_server_that_loses_the_first_answer(stock: CellThread) -> None:
    stock.do("lose_first_reply", on=True)
    arm = AbbArm(stock.url("abb"), deadlines=HASTY)
    arm.connect()
    arm.disconnect()


def test_stock_cannot_be_stopped_and_says_so(stock: CellThread) -> None:
    arm = connected(stock)
    assert not arm.can_stop
    arm.arm()
    with pytest.raises(CannotStop):
        arm.stop()
    with pytest.raises(NotArmed):
        arm.move_to(FAR)
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
