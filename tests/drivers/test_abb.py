"""The ABB driver on the simulated controller: motion, stop, modes, limits, a second client."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from drivers import (
    AbbArm,
    AbbDeadlines,
    CommandRefused,
    EmergencyStop,
    LinkTimeout,
    ProtectiveStop,
    WrongMode,
)
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.waiting import PATIENCE_S, under_way, until

FAR = (90.0, 60.0, 30.0, 40.0, 50.0, 60.0)
FAST = CellFile(time_scale=10_000.0, effects=("none",))
ROBOT, DEVICES = "abb-irb120", ("abb", "faro")
HASTY = AbbDeadlines(ping_s=0.4, move_margin_s=0.3, move_factor=0.01)


RAPID = Path(__file__).parents[2] / "drivers" / "abb" / "robot_side"


def module(name: str) -> str:
    """A module for the controller without its comments."""
    lines = (RAPID / name).read_text(encoding="ascii").splitlines()
    return "\n".join(line.split("!")[0].rstrip() for line in lines)


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
    """T_ROB1 reports that it was stopped, without an emergency stop and without our stop."""
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


def test_a_first_trial_moves_at_reduced_speed(fast: CellThread) -> None:
    """The robot moves at reduced speed while the enabling device holds the motors on."""
    fast.do("mode", mode="manual")
    arm = connected(fast, speed_mm_s=500.0, speed_deg_s=20.0)
    arm.arm()
    assert fast.cell is not None
    assert fast.cell.abb.speed == [250.0, 10.0]
    assert arm.move_to((1.0, 2.0, 3.0, 4.0, 5.0, 6.0)).joints_deg == (1.0, 2.0, 3.0, 4.0, 5.0, 6.0)
    fast.do("mode", mode="auto")
    arm.arm()
    assert fast.cell.abb.speed == [500.0, 20.0]
    fast.do("mode", mode="manual_full")
    with pytest.raises(WrongMode):
        arm.move_to(FAR)
    with pytest.raises(WrongMode, match="manual"):
        arm.arm()
    fast.do("mode", mode="manual")
    fast.do("motors", on=False)
    with pytest.raises(WrongMode) as caught:
        arm.arm()
    assert "enabling device" in caught.value.what_to_do
    arm.disconnect()


def test_a_controller_that_does_not_tell_its_limits_moves_nothing(fast: CellThread) -> None:
    arm = connected(fast)
    arm.arm()
    assert fast.cell is not None
    moves = fast.cell.arm.moves
    fast.cell.abb.limits_told = False
    with pytest.raises(CommandRefused, match="joint limits"):
        arm.move_to(FAR)
    assert fast.cell.arm.moves == moves
    arm.disconnect()


def test_the_motion_task_stops_and_starts_itself() -> None:
    """StartMove frees only what StopMove of the same task, with the same switches, stopped."""
    server, back = module("CALSRV.mod"), module("CALBACK.mod")
    assert "StopMove" not in back
    assert "StartMove" not in back
    trap = server.split("TRAP aborted")[1].split("ENDTRAP")[0]
    steps = re.findall(r"(StopMove|ClearPath|StartMove)", trap)
    assert steps == ["StopMove", "ClearPath", "StartMove"]
    assert len(re.findall("StopMove|StartMove", server)) == 2
    assert "AllMotionTasks" not in server
    halt = back.split("PROC halt")[1].split("ENDPROC")[0]
    assert re.findall(r"calAbort:=(\w+);", halt) == ["FALSE", "TRUE"]  # a change, whatever it was before
    main = server.split("PROC main()")[1].split("ENDPROC")[0]
    assert main.index("calAbort:=FALSE;") < main.index("IPers")


def test_the_motion_task_reads_limits_and_moves_in_two_modes() -> None:
    server = module("CALSRV.mod")
    assert "CalcRobT" not in server
    assert set(re.findall(r'"(\w+_joint_bound)"', server)) == {"upper_joint_bound", "lower_joint_bound"}
    go = server.split("CASE 209:")[1].split("CASE 202:")[0]
    assert set(re.findall(r"OP_\w+", go)) == {"OP_AUTO", "OP_MAN_PROG"}
    assert go.index("OP_MAN_PROG") < go.index("move;")
    kept = server.split("CASE 201:")[1].split("CASE 209:")[0]
    assert kept.index("limitFault") < kept.index("kept:=")
    assert "CALBACK`, type SEMISTATIC" in (RAPID / "README.md").read_text(encoding="utf-8")
