"""The forecast of a run is made in a worker process, and nothing waits for it."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from acquisition import Devices, LeaseDeadline, Run, checked_plan
from acquisition.run import Forecast, forecast_of
from service.http.runs.run_manager import RunComputations, RunManager
from service.http.wire.problems import Problem
from service.http.work.workers import Workers
from tests.acquisition.fakes import Bench, FakeMeter, a_campaign, a_cell
from tests.drivers.waiting import PATIENCE_S, until
from tests.service.slow_arm import SlowArm


class HeldWorkers(Workers):
    """Worker that is busy until it is released, and then may refuse."""

    def __init__(self) -> None:
        super().__init__(1, waiting=0)
        self.let_go, self.refusal = threading.Event(), False
        self.called: list[object] = []

    def call(self, function: Callable[..., Any], *args: Any) -> Any:
        self.called.append(function)
        assert self.let_go.wait(PATIENCE_S)
        if self.refusal:
            raise Problem(503, "Too much is being computed.", "Ask again.")
        return function(*args)


@pytest.fixture
def workers() -> Iterator[HeldWorkers]:
    made = HeldWorkers()
    yield made
    made.let_go.set()


@pytest.mark.parametrize("refused", [False, True])
def test_a_run_moves_before_its_forecast_is_there(
    tmp_path: Path, workers: HeldWorkers, refused: bool
) -> None:
    bench = Bench(a_cell())
    arm = SlowArm(bench)
    devices = Devices(arm, FakeMeter(bench))
    workers.refusal = refused
    plan = a_campaign(), checked_plan(bench.cell, a_campaign())
    with closing(RunManager(tmp_path, lambda _: devices, workers, simulated=True)) as book:
        name = book.start(bench.cell, plan, "a run", LeaseDeadline("anna", 300.0))
        try:
            assert arm.moving.wait(PATIENCE_S)
            assert workers.called == [forecast_of]
            assert book.document(name)["seconds_left"] is None
            workers.let_go.set()
            if not refused:
                until(lambda: book.document(name)["seconds_left"] is not None)
            assert book.document(name)["state"] == "running"
        finally:
            book.stop(name, by="anna")
        assert book.join(PATIENCE_S)


def test_it_is_made_by_another_process(tmp_path: Path) -> None:
    cell, campaign = a_cell(), a_campaign()
    workers = Workers(1, waiting=0)
    try:
        with Run.create(tmp_path, cell, campaign, simulated=True) as run:
            assert workers.call(os.getpid) != os.getpid()
            made = RunComputations(workers)(forecast_of, run.folder).result(PATIENCE_S)
    finally:
        workers.close()
    here = Forecast.of(cell, campaign, checked_plan(cell, campaign))
    assert made.total_s == pytest.approx(here.total_s)
