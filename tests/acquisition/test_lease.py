"""The robot moves only while its owner is heard of."""

from __future__ import annotations

import threading
from contextlib import closing
from pathlib import Path

from acquisition import LeaseDeadline, Run
from acquisition.run.clock import ScaledClock
from drivers import RemoteOperator
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of
from tests.drivers.waiting import until
from tests.service.lease_clock import LeaseClock


def test_a_lease_lapses_once_and_not_while_it_beats() -> None:
    lapses: list[float] = []
    clock = LeaseClock()
    lease = LeaseDeadline("page", 10.0, clock)
    with lease.watched(lambda: lapses.append(clock.now())):
        for _ in range(5):
            clock.pass_by(9.0)
            lease.beat()
        clock.pass_by(9.0)
        assert lapses == []
        clock.pass_by(1.0)
        until(lambda: lapses)
        assert lease.left_s <= 0.0
    assert lapses == [55.0]


def test_a_lease_that_is_given_up_in_time_says_nothing() -> None:
    lapses: list[threading.Thread] = []
    with LeaseDeadline("page", 3600.0).watched(lambda: lapses.append(threading.current_thread())):
        pass
    assert lapses == []
    with LeaseDeadline("page", -1.0).watched(lambda: lapses.append(threading.current_thread())):
        assert lapses == [
            threading.current_thread()
        ]  # before anything moves, and no thread has to come first
    assert len(lapses) == 1


def test_a_lease_that_is_shortened_ends_early() -> None:
    class Waiting(ScaledClock):
        entered = threading.Event()

        def wait(self, seconds: float, wake: threading.Event) -> bool:
            self.entered.set()
            return super().wait(seconds, wake)

    lapses: list[int] = []
    clock = Waiting()
    lease = LeaseDeadline("page", 3600.0, clock)
    with lease.watched(lambda: lapses.append(1)):
        until(clock.entered.is_set)
        lease.beat(0.0)
        until(lambda: lapses)


def test_a_run_whose_owner_falls_silent_is_paused_with_the_reading_in_hand(tmp_path: Path) -> None:
    bench = Bench(a_cell())
    with closing(Run.create(tmp_path, bench.cell, a_campaign(), simulated=True)) as run:
        devices = devices_of(bench, SeatingOperator(bench))
        clock = LeaseClock()
        lease = LeaseDeadline("cell PC", 1.0, clock)

        def heard() -> None:
            clock.pass_by(0.9)
            lease.beat()

        def fall_silent() -> None:
            clock.pass_by(1.0)
            until(lambda: any(event.data.get("by") == "watchdog of cell PC" for event in run.events()))

        bench.faults = dict.fromkeys(range(1, 10), heard) | {10: fall_silent}
        outcome = run.execute(devices, JumpingClock(), lease=lease)
        assert outcome.state.value == "paused"
        assert outcome.reason == "cell PC was not heard of for 1 s."
        assert bench.calls == 10
        assert run.status().done == 1
        run.resume(by="anna")
        again = LeaseDeadline("cell PC", 3600.0)
        assert run.execute(devices, JumpingClock(), lease=again).state.value == "succeeded"


def test_a_lease_that_ended_before_moves_nothing_and_stop_needs_none(tmp_path: Path) -> None:
    bench = Bench(a_cell(instrument__one_smr=True))
    with closing(Run.create(tmp_path, bench.cell, a_campaign(), simulated=True)) as run:
        outcome = run.execute(
            devices_of(bench, RemoteOperator()), JumpingClock(), lease=LeaseDeadline("page", -1.0)
        )
        assert outcome.state.value == "paused"
        assert bench.log == []
        run.stop(by="anybody")
        assert run.status().state == "stopped"
