"""A silent lease holder: the robot stops, the run is paused, the next holder continues it.

These would catch: a second move after the lapse, a reading that is lost or taken without its approach, and a lapse that
ends the run for good. They would also catch a prompt that waits for a person who has gone, and a stop that requires
the lease.
"""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from acquisition import ExecutionOutcome, LeaseDeadline, Run
from drivers import Answer, RemoteOperator
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of
from tests.drivers.waiting import PATIENCE_S, until
from tests.service.lease_clock import LeaseClock

SECONDS = 30.0
SILENT = "anna was not heard of for 30 s."


@contextmanager
def a_run(folder: Path, **cell: object) -> Iterator[tuple[Bench, Run]]:
    bench = Bench(a_cell(**cell))
    with Run.create(folder / "record", bench.cell, a_campaign(), simulated=True) as run:
        yield bench, run


def lapse_at(bench: Bench, clock: LeaseClock, run: Run, call: int) -> None:
    """Let the lease lapse during this call to a device.

    The call returns when the run knows of it.
    """

    def fall_silent() -> None:
        clock.pass_by(SECONDS + 1.0)
        until(lambda: any(event.data.get("by") == "watchdog of anna" for event in run.events()))

    bench.faults[call] = fall_silent


def everything_once(bench: Bench, run: Run) -> None:
    """Nine readings, each after an approach with nothing in between, none twice."""
    readings = [e.data for e in run.events() if e.kind == "reading" and e.data["target"].startswith("T")]
    assert len({data["pose"] for data in readings}) == len(readings) == run.status().total
    shots = [shot for shot in bench.shots.values() if shot.target.startswith("T")]
    assert all(shot.quiet_moves >= 2 for shot in shots)


# 4 calls connect and arm, 5 to 7 measure nests, 8 goes to the approach point, 9 to the pose, 10 measures T1
@pytest.mark.parametrize(("call", "what"), [(8, "move"), (9, "move"), (10, "measure T1"), (6, "measure N2")])
def test_what_is_under_way_ends_and_nothing_else_begins(tmp_path: Path, call: int, what: str) -> None:
    with a_run(tmp_path) as (bench, run):
        clock = LeaseClock()
        lapse_at(bench, clock, run, call)
        devices = devices_of(bench, SeatingOperator(bench))
        outcome = run.execute(devices, JumpingClock(), lease=LeaseDeadline("anna", SECONDS, clock))
        assert (outcome.state.value, outcome.reason, outcome.error) == ("paused", SILENT, None)
        assert bench.log[-1] == what
        assert bench.calls == call  # the robot went nowhere else
        assert run.status().done == (1 if call == 10 else 0)
        run.resume(by="bert")
        assert (
            run.execute(devices, JumpingClock(), lease=LeaseDeadline("bert", SECONDS, clock)).state.value
            == "succeeded"
        )
        everything_once(bench, run)


def test_a_question_is_not_put_to_somebody_who_has_gone(tmp_path: Path) -> None:
    with a_run(tmp_path, instrument__one_smr=True) as (bench, run):
        clock, operator = LeaseClock(), RemoteOperator()
        outcomes: list[ExecutionOutcome] = []
        lease = LeaseDeadline("anna", SECONDS, clock)
        thread = threading.Thread(
            target=lambda: outcomes.append(
                run.execute(devices_of(bench, operator), JumpingClock(), lease=lease)
            )
        )
        thread.start()
        until(lambda: operator.pending)
        clock.pass_by(SECONDS + 1.0)
        thread.join(PATIENCE_S)
        assert outcomes[0].reason == SILENT
        assert operator.pending is None
        assert run.status().prompt is None
        run.resume(by="bert")
        devices = devices_of(bench, SeatingOperator(bench, [Answer.CONFIRM]))
        assert (
            run.execute(devices, JumpingClock(), lease=LeaseDeadline("bert", SECONDS, clock)).state.value
            == "succeeded"
        )
        everything_once(bench, run)


def test_a_lapse_while_a_pause_waits_for_its_reading_is_at_once(tmp_path: Path) -> None:
    """The run is paused on the way to the approach point.

    Without the lapse, the robot would still go to the pose.
    """
    with a_run(tmp_path) as (bench, run):
        clock = LeaseClock()

        def pause_and_go() -> None:
            run.pause("anna")
            clock.pass_by(SECONDS + 1.0)
            until(lambda: any(event.data.get("by") == "watchdog of anna" for event in run.events()))

        bench.faults[8] = pause_and_go
        devices = devices_of(bench, SeatingOperator(bench))
        outcome = run.execute(devices, JumpingClock(), lease=LeaseDeadline("anna", SECONDS, clock))
        assert outcome.reason == "Paused on request."  # who asked first
        assert bench.calls == 8


def test_a_beat_prolongs_and_shortens(tmp_path: Path) -> None:
    clock, lapses = LeaseClock(), []
    lease = LeaseDeadline("anna", SECONDS, clock)
    with lease.watched(lambda: lapses.append(clock.now())):
        clock.pass_by(SECONDS - 1.0)
        lease.beat()
        clock.pass_by(SECONDS - 1.0)
        assert lapses == []
        lease.beat(3.0)
        assert lease.left_s == 3.0
        clock.pass_by(4.0)
        until(lambda: lapses)
    assert lapses == [2 * (SECONDS - 1.0) + 4.0]


def test_stop_needs_no_lease(tmp_path: Path) -> None:
    with a_run(tmp_path) as (bench, run):
        clock = LeaseClock()
        problems: list[object] = []

        def fall_silent_and_stop() -> None:
            clock.pass_by(SECONDS + 1.0)
            problems.append(run.stop(by="anybody"))

        bench.faults[8] = fall_silent_and_stop
        devices = devices_of(bench, SeatingOperator(bench))
        outcome = run.execute(devices, JumpingClock(), lease=LeaseDeadline("anna", SECONDS, clock))
        assert outcome.state.value == "stopped"
        assert bench.calls == 8
        assert problems == [[]]
