"""The driver for abb_driver on the simulated controller.

Motion, stop, modes, limits, a second client.
"""

from __future__ import annotations

import io
import json
import math
import signal
import socket
import subprocess
import sys
from dataclasses import replace
from typing import Any

import pytest

from drivers import (
    AbbSimpleArm,
    AbbSimpleDeadlines,
    Busy,
    LinkError,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    NotReached,
    WireLog,
)
from mocks.abb.simple import LAST, START, STOP, SimpleMessageServers
from mocks.cell import CellThread
from tests.drivers.waiting import PATIENCE_S, under_way

FAR = (90.0, 60.0, 30.0, 40.0, 50.0, 60.0)
ROBOT, DEVICES = "abb-irb120", ("abb-simple",)
PATIENT = AbbSimpleDeadlines(connect_s=30.0, reply_s=30.0, stop_s=30.0, settle_s=30.0)
HASTY = AbbSimpleDeadlines(reply_s=0.4, takeover_s=0.2)  # for connections that are to fail


def connected(cell: CellThread, **options: Any) -> AbbSimpleArm:
    arm = AbbSimpleArm(cell.url("abb-simple"), **options)
    arm.connect()
    return arm


def servers(cell: CellThread) -> SimpleMessageServers:
    assert cell.cell is not None
    return cell.cell.abb_simple


def test_a_move_keeps_both_caps_and_reads_back_in_single_precision(fast: CellThread) -> None:
    arm = connected(fast, speed_deg_s=30.0, speed_mm_s=400.0)
    arm.arm()
    reached = arm.move_to(FAR)
    assert reached.joints_deg == pytest.approx(FAR, abs=1e-5)
    assert 0.6e-5 < reached.resolution_deg < 1.4e-5
    first, last = servers(fast).received[-2:]
    assert (first.sequence, last.sequence) == (START, LAST)
    assert first.joints_deg == (0.0,) * 6
    assert last.duration_s >= 90.0 / 30.0
    longest_path_mm = math.radians(90 + 60 + 30) * 1000.0 + math.radians(40 + 50 + 60) * 400.0
    assert last.duration_s >= longest_path_mm / 400.0
    arm.disconnect()


@pytest.mark.parametrize("step", [0.03, 0.09])
def test_a_step_below_tolerance_or_skipping_is_carried_out(fast: CellThread, step: float) -> None:
    arm = connected(fast)
    arm.arm()
    reached = arm.move_to((step, 0, 0, 0, 0, 0))
    assert reached.joints_deg[0] == pytest.approx(step, abs=1e-5)
    assert fast.do("state")["joints_deg"][0] == pytest.approx(step, abs=1e-5)
    arm.disconnect()


def test_a_step_below_tolerance_is_awaited_though_it_begins_late(slow: CellThread) -> None:
    servers(slow).throttle_s = 0.4
    arm = connected(slow)
    arm.arm()
    assert arm.move_to((0.03, 0, 0, 0, 0, 0)).joints_deg[0] == pytest.approx(0.03, abs=1e-5)
    arm.disconnect()


def test_a_stop_that_overtakes_the_move_keeps_it_from_being_sent(fast: CellThread) -> None:
    arm = connected(fast)
    arm.arm()
    arm._motion.stopped.set()
    with pytest.raises(MotionStopped):
        arm.move_to(FAR)
    assert LAST not in [point.sequence for point in servers(fast).received]
    assert fast.do("state")["joints_deg"] == (0.0,) * 6
    arm.disconnect()


def test_stop_is_repeated_on_a_fresh_connection(slow: CellThread) -> None:
    arm = connected(slow)
    arm.arm()
    move = under_way(arm, FAR, slow)
    arm._motion.close()
    arm.stop()
    assert not slow.do("state")["moving"]
    with pytest.raises(MotionStopped):
        move.result(PATIENCE_S)
    arm.disconnect()


def test_disconnect_from_another_thread_ends_a_pending_move_and_the_robot_stops(slow: CellThread) -> None:
    arm = connected(slow)
    arm.arm()
    move = under_way(arm, FAR, slow)
    arm.disconnect()
    with pytest.raises(LinkError):
        move.result(PATIENCE_S)
    assert not slow.do("state")["moving"]
    assert max(slow.do("state")["joints_deg"]) < 60.0
    with pytest.raises(LinkLost):
        arm.arm()


def test_second_client_is_told_and_nothing_it_sent_moves_the_robot(fast: CellThread) -> None:
    first = connected(fast)
    second = AbbSimpleArm(fast.url("abb-simple"), deadlines=HASTY)
    with pytest.raises(LinkTimeout) as caught:
        second.connect()
    assert "no other program" in caught.value.what_to_do
    first.disconnect()
    second.deadlines = PATIENT
    second.connect()
    assert {point.sequence for point in servers(fast).received} == {STOP}
    second.disconnect()


def test_another_client_on_the_motion_port_alone(fast: CellThread) -> None:
    with socket.create_connection(("127.0.0.1", fast.port("abb-simple"))):
        arm = AbbSimpleArm(fast.url("abb-simple"), deadlines=HASTY)
        with pytest.raises(LinkTimeout) as caught:
            arm.connect()
    assert "no other program" in caught.value.what_to_do


def test_another_program_moves_the_robot(slow: CellThread) -> None:
    arm = connected(slow, deadlines=replace(PATIENT, settle_s=0.3))
    arm.arm()
    assert slow.cell is not None
    slow.cell.arm.start(FAR, rate_deg_s=10.0, tool_mm_s=math.inf)
    assert arm.status().moving
    with pytest.raises(Busy):
        arm.position()
    with pytest.raises(Busy):
        arm.move_to((0.0,) * 6)
    assert {point.sequence for point in servers(slow).received} == {STOP}
    arm.disconnect()


def test_a_move_that_takes_too_long_is_stopped(slow: CellThread) -> None:
    arm = connected(slow, speed_deg_s=5.0, deadlines=replace(PATIENT, move_factor=0.0, move_margin_s=0.3))
    arm.arm()
    with pytest.raises(NotReached, match="move_s"):
        arm.move_to(FAR)
    assert not slow.do("state")["moving"]
    arm.disconnect()


def test_the_wire_log_has_what_was_said_and_the_states_that_were_used(fast: CellThread) -> None:
    text = io.StringIO()
    arm = connected(fast, wire=WireLog(text))
    arm.arm()
    reached = arm.move_to(FAR)
    arm.disconnect()
    rows = [json.loads(line) for line in text.getvalue().splitlines()]
    sent = [row["data"] for row in rows if (row["device"], row["dir"]) == ("abb-simple", ">")]
    assert [len(data) for data in sent] == [68, 68, 68]
    seen = [row["data"] for row in rows if row["device"] == "abb-simple-state"]
    assert seen[-1].encode("latin-1") == reached.raw


def test_simulator_as_a_process() -> None:
    command = [sys.executable, "-W", "error", "-m", "mocks", "abb-simple", "--time-scale", "10000"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        motion, state, _ = (json.loads(process.stdout.readline()) for _ in range(3))
        assert (motion["device"], motion["protocol"]) == ("abb-simple", "simple_message")
        assert state["port"] == motion["port"] + 2
        arm = AbbSimpleArm(f"tcp://127.0.0.1:{motion['port']}")
        arm.connect()
        arm.arm()
        arm.move_to(FAR)
        arm.disconnect()
        process.send_signal(signal.SIGTERM)
        assert process.wait(PATIENCE_S) == 0
