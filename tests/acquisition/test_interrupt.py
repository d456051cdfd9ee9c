"""Ctrl-C pauses, twice stops; and the clock that all waits go through."""

from __future__ import annotations

import signal
import sys
import threading
from contextlib import closing
from pathlib import Path
from typing import cast

import pytest

from acquisition import Run, ScaledClock, pausing_on_interrupt
from acquisition.run.orders.control import Control, Pausing, Stopping
from drivers import AcquisitionError, CannotStop
from tests.acquisition.fakes import JumpingClock
from tests.acquisition.stage import ALL, Stage
from tests.drivers.waiting import PATIENCE_S, until


@pytest.mark.parametrize(("times", "state"), [(1, "paused"), (2, "stopped")])
def test_ctrl_c(tmp_path: Path, times: int, state: str) -> None:
    stage = Stage(tmp_path)
    before = signal.getsignal(signal.SIGINT)

    def press() -> None:
        execution = stage.run._execution
        assert execution is not None
        signal.raise_signal(signal.SIGINT)
        until(lambda: execution.control.asked)
        if times == 2:
            signal.raise_signal(signal.SIGINT)
            until(lambda: execution.control.stopping)

    stage.bench.faults[10] = press
    with closing(stage.run), pausing_on_interrupt(stage.run):
        outcome = stage.execute()
        assert (outcome.state.value, outcome.exit_code) == (state, 130)
        until(lambda: sum(event.kind == "command" for event in stage.run.events()) == times)
    assert stage.bench.log == ALL[:10]
    assert signal.getsignal(signal.SIGINT) is before


@pytest.mark.skipif(not hasattr(signal, "SIGHUP"), reason="a system without hang-ups")
def test_a_terminal_that_is_closed_pauses_however_often_it_is_said(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    started = signal.signal(signal.SIGHUP, signal.SIG_DFL)  # these tests may run under nohup

    def close() -> None:
        for times in (1, 2):
            signal.raise_signal(signal.SIGHUP)
            until(lambda n=times: sum(event.kind == "command" for event in stage.run.events()) == n)

    stage.bench.faults[10] = close
    with closing(stage.run), pausing_on_interrupt(stage.run):
        outcome = stage.execute()
        assert (outcome.state.value, outcome.reason) == ("paused", "The terminal was closed.")
    assert stage.bench.log == ALL[:10]
    assert signal.signal(signal.SIGHUP, started) is signal.SIG_DFL


class Ordered:
    """A run that notes its orders."""

    def __init__(self) -> None:
        self.paused, self.stopped = threading.Event(), threading.Event()

    def pause(self, by: str) -> None:
        self.paused.set()

    def stop(self, by: str) -> list[AcquisitionError]:
        self.stopped.set()
        return [CannotStop("has no stop", device="arm")]


def test_ctrl_c_is_heard_while_the_main_thread_sleeps() -> None:
    """Another thread gets the signal just before the main thread begins its wait.

    The main thread then sleeps on, because no signal interrupts it.
    """
    run, sleeper = Ordered(), threading.main_thread().ident
    assert sleeper is not None

    def press(begun: threading.Event) -> None:
        begun.wait()
        until(lambda: sys._current_frames()[sleeper].f_code.co_name == "wait")
        signal.pthread_kill(threading.get_ident(), signal.SIGINT)

    told: list[str] = []
    with pausing_on_interrupt(cast(Run, run), tell=told.append):
        for heard in (run.paused, run.stopped):
            begun = threading.Event()
            threading.Thread(target=press, args=(begun,)).start()
            begun.set()
            assert heard.wait(PATIENCE_S)
    (sentence,) = told  # a stop that reaches nobody does not look like one that did
    assert "has no stop" in sentence


def test_scaled_clock_waits_less_and_wakes() -> None:
    clock, wake = ScaledClock(1000.0), threading.Event()
    before = clock.now()
    assert not clock.wait(10.0, wake)
    assert clock.now() - before >= 9.0
    wake.set()
    assert clock.wait(1e9, wake)


def test_orders_end_waits() -> None:
    control = Control(JumpingClock())
    control.wait(5.0)
    control.pause()
    control.settle(5.0)  # a pause leaves the reading in hand alone
    with pytest.raises(Pausing):
        control.wait(5.0)
    control.stop()
    with pytest.raises(Stopping):
        control.settle(5.0)


def test_a_stop_while_the_robot_is_armed_arms_nothing_else(tmp_path: Path) -> None:
    stage = Stage(tmp_path)
    arming = ALL.index("arm arm") + 1

    def stop() -> None:
        stage.run.stop(by="anna")

    stage.bench.faults[arming] = stop
    with closing(stage.run):
        assert stage.execute().state.value == "stopped"
    assert stage.bench.log == ALL[:arming]


class FullLengths(JumpingClock):
    """A clock that keeps which of its waits an event would have cut short."""

    def __init__(self) -> None:
        super().__init__()
        self.cut: list[bool] = []

    def wait(self, seconds: float, wake: threading.Event) -> bool:
        self.cut.append(wake.is_set())
        return super().wait(seconds, wake)


def test_a_pause_leaves_the_settling_its_whole_length_and_a_rest_does_not() -> None:
    clock = FullLengths()
    control = Control(clock)
    control.pause()
    control.settle(5.0)
    assert clock.cut == [False]
    control.rest("nobody answers")
    with pytest.raises(Pausing):
        control.check_stop()  # which stands before every motion
    with pytest.raises(Pausing):
        control.settle(5.0)
    assert clock.cut == [False, True]
