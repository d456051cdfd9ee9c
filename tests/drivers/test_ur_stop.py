"""The arm stops when a move of the UR driver ends early.

Causes are stop, disconnect, watchdog, and a link that was cut.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from typing import Any

import pytest

from drivers import LinkError, LinkLost, MotionStopped, NotArmed, UrArm
from drivers.ur.motion import UrScriptMove
from mocks.cell import CellThread
from mocks.faultproxy import FaultProxy
from tests.drivers.nobody import nobody_listens
from tests.drivers.ur_bench import FAR, PATIENT, creeping
from tests.drivers.waiting import PATIENCE_S, in_thread, under_way, until

ROBOT, DEVICES = "ur5", ("ur",)


class Doorkeeper:
    """Gate that holds clients of all connections except RTDE while `open` is cleared.

    `waiting` is set when a client is held.
    """

    def __init__(self) -> None:
        self.open, self.waiting = threading.Event(), threading.Event()
        self.open.set()

    def record(self, device: str, direction: str, data: bytes) -> None:
        if data.startswith(b"open") and not self.open.is_set():
            self.waiting.set()
            assert self.open.wait(PATIENCE_S)


@pytest.fixture(params=["", "?feed=realtime"])
def feed(request: pytest.FixtureRequest) -> str:
    return request.param


def test_stop_ends_a_pending_move(slow: CellThread, feed: str) -> None:
    # A program that was stopped before its first state came is waited for during start_s: it may yet begin.
    arm = creeping(slow, feed, deadlines=replace(PATIENT, start_s=3.0))
    arm.arm()
    move = under_way(arm, FAR, slow)
    arm.stop()
    state = slow.do("state")
    assert not state["moving"]
    with pytest.raises(MotionStopped):
        move.result(timeout=PATIENCE_S)
    assert slow.do("state")["joints_deg"] == state["joints_deg"]
    with pytest.raises(NotArmed):
        arm.move_to(FAR)
    arm.arm()
    # the joints that are read back trail the target, as behind any servo
    assert arm.position().joints_deg == pytest.approx(slow.do("state")["joints_deg"], abs=0.013)
    arm.disconnect()


def test_stop_that_overtakes_the_program_is_said_again(slow: CellThread) -> None:
    """The controller took the stop first: the move sent before it begins after it."""
    arm = creeping(slow)
    arm.arm()
    send = slow.cell.ur.submit if slow.cell else None
    assert send is not None
    assert slow.cell is not None
    late: list[list[str]] = []

    def hold_back(lines: list[str]) -> bytes:
        if len(lines) > 1 and not late:
            late.append(lines)
        else:
            send(lines)
            if late and len(late) == 1:
                late.append([])
                send(late[0])
        return b""

    slow.cell.ur.submit = hold_back
    move = in_thread(lambda: arm.move_to(FAR))
    until(lambda: late)
    in_thread(arm.stop)
    with pytest.raises((MotionStopped, LinkError)):
        move.result(timeout=PATIENCE_S)
    until(lambda: not slow.do("state")["moving"])
    assert max(slow.do("state")["joints_deg"]) < 45.0
    arm.disconnect()


def test_disconnect_from_another_thread_ends_a_pending_move_and_the_motion(
    slow: CellThread, feed: str
) -> None:
    arm = creeping(slow, feed)
    arm.arm()
    move = under_way(arm, FAR, slow)
    arm.disconnect()
    with pytest.raises((LinkError, MotionStopped)):
        move.result(timeout=PATIENCE_S)
    assert not slow.do("state")["moving"]


def test_disconnect_does_not_cut_the_stop_of_the_move_that_it_ends(slow: CellThread) -> None:
    """The move, without states, sends its stop over a separate connection.

    Disconnect is closing the other connections meanwhile.
    """
    door = Doorkeeper()
    arm = creeping(slow, wire=door)
    arm.arm()
    move = under_way(arm, FAR, slow)
    close = arm._rtde.close

    def close_and_see_the_stop_begin() -> None:
        door.open.clear()
        close()
        assert door.waiting.wait(PATIENCE_S)

    arm._rtde.close = close_and_see_the_stop_begin
    arm.disconnect()
    door.open.set()
    with pytest.raises((LinkError, MotionStopped)):
        move.result(timeout=PATIENCE_S)
    assert not slow.do("state")["moving"]


def test_after_a_disconnect_no_program_is_sent(slow: CellThread, feed: str) -> None:
    arm = creeping(slow, feed)
    arm.arm()
    talk = arm._ports[0].talk

    @contextmanager
    def late(command: str, **keywords: bool) -> Iterator[Any]:
        with talk(command, **keywords) as conversation:
            if command == "move_to":
                arm.disconnect()
                arm._ports[0]._asked.clear()
                with talk(command) as again:  # a connection that disconnect came too early to see
                    yield again
                return
            yield conversation

    arm._ports[0].talk = late
    with pytest.raises((LinkError, MotionStopped)):
        arm.move_to(FAR)
    assert slow.do("state")["joints_deg"] == (0.0,) * 6


def test_watchdog_stops_the_robot_when_the_program_is_gone(slow: CellThread) -> None:
    arm = creeping(slow, watchdog_s=0.4)
    arm.arm()
    arm._motion.halt = lambda: None  # type: ignore[method-assign]  # a dead program says no stop
    move = under_way(arm, FAR, slow)
    arm._rtde.close()
    with pytest.raises(LinkError):
        move.result(timeout=PATIENCE_S)
    until(lambda: not slow.do("state")["moving"])
    assert max(slow.do("state")["joints_deg"]) < 45.0


@pytest.mark.parametrize("closed", [(), ("dashboard",), ("secondary",)])
def test_stop_where_30003_is_gone(slow: CellThread, closed: tuple[str, ...]) -> None:
    """Port 30002 and the dashboard take a stop as well; either is enough.

    RTDE shows that the arm stands still.
    """
    with FaultProxy(slow.port("ur-realtime")) as proxy, nobody_listens() as nobody:
        ports = {name: slow.port("ur-" + name) for name in ("secondary", "dashboard")}
        options = "&".join(f"{name}={nobody if name in closed else port}" for name, port in ports.items())
        arm = creeping(slow, f"?realtime={proxy.port}&{options}")
        arm.arm()
        move = under_way(arm, FAR, slow)
        proxy.spoil("close", times=1_000_000)
        arm.stop()
        assert not slow.do("state")["moving"]
        with pytest.raises((MotionStopped, LinkError)):
            move.result(timeout=PATIENCE_S)
        assert max(slow.do("state")["joints_deg"]) < 45.0
        arm.disconnect()


def test_an_arm_that_goes_on_to_its_target_was_not_stopped(slow: CellThread) -> None:
    """A person at the pendant has switched to local control.

    The controller takes no order, and the arm arrives.
    """
    assert slow.cell is not None
    ur, late_s = slow.cell.ur, [0.0]
    arm = creeping(slow, clock=lambda: time.monotonic() + late_s[0])
    arm.arm()
    move = under_way(arm, FAR, slow)
    ur.arm.mode = "manual"
    stop = in_thread(arm.stop)
    until(lambda: ur.refused)
    late_s[0] = 2.0  # as if it had crept on for so long
    slow.do("jog", joints_deg=FAR)
    with pytest.raises(LinkError, match="did not obey the stop"):
        stop.result(timeout=PATIENCE_S)
    with pytest.raises((MotionStopped, LinkError)):
        move.result(timeout=PATIENCE_S)
    ur.arm.mode = "auto"
    arm.disconnect()


def test_watchdog_is_fed_during_a_long_move(slow: CellThread) -> None:
    arm = creeping(slow)
    arm.arm()
    move = in_thread(lambda: arm.move_to(FAR))
    assert slow.cell is not None
    seen = slow.cell.ur.registers.received
    for _ in range(3):
        last = dict(seen)
        until(lambda last=last: seen != last)
    assert not move.done()
    arm.stop()
    with pytest.raises(MotionStopped):
        move.result(PATIENCE_S)
    arm.disconnect()


def test_the_watchdog_is_given_a_frequency() -> None:
    text = UrScriptMove((0.0,) * 6, 1.0, 1.0, number=1, watchdog_s=2.0).text()
    assert "  guard = 0.500\n" in text
    assert '"input_int_register_46", guard, "stop"' in text


def test_reconnect_over_a_slow_link_after_a_move_that_was_cut(slow: CellThread) -> None:
    with FaultProxy(slow.port("ur")) as proxy:
        ports = "&".join(
            f"{name}={slow.port('ur-' + name)}" for name in ("realtime", "secondary", "dashboard")
        )
        arm = UrArm(
            f"tcp://127.0.0.1:{proxy.port}?{ports}", deadlines=PATIENT, speed_deg_s=2.0, watchdog_s=30.0
        )
        arm.connect()
        arm.arm()
        move = under_way(arm, FAR, slow)
        proxy.spoil("close")
        with pytest.raises(LinkLost):
            move.result(timeout=PATIENCE_S)
        assert not slow.do("state")["moving"]
        proxy.spoil("delay", times=3)  # longer than the pause in which a moving arm's watchdog is fed
        arm.connect()
        arm.arm()
        arm.disconnect()
