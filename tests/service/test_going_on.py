"""A continued run is never shown as it was at rest.

A client that waits for the next pause would take the old pause for it.
"""

from __future__ import annotations

import os
import threading
from concurrent.futures import Future
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from acquisition import Cell, Devices, LeaseDeadline, checked_plan
from acquisition.run import Forecast
from service.http.runs.run_manager import RunComputations, RunManager
from service.http.work.stored_documents import readable
from service.http.work.workers import Workers
from tests.acquisition.fakes import Bench, a_campaign, a_cell, devices_of
from tests.drivers.waiting import PATIENCE_S, until


def test_a_run_that_was_resumed_is_shown_when_it_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cell = a_cell(simulation={"time_scale": 1000.0})
    bench, lease, asked = Bench(cell), LeaseDeadline("anna", 3600.0), threading.Event()

    def open_devices(_: Cell) -> Devices:
        return devices_of(bench)

    class Slowly(RunComputations):
        """Computations of a run that does not begin until its state has been requested."""

        def __call__(self, *_: object) -> Future[Forecast]:  # type: ignore[override]
            asked.wait(PATIENCE_S)
            return Future()

    with (
        closing(Workers(1, waiting=0)) as workers,
        closing(RunManager(tmp_path / "runs", open_devices, workers, simulated=True)) as book,
    ):
        campaign = a_campaign(settle_s=0.0)
        bench.faults[10] = lambda: book.pause(str(book.busy_with), by="anna")
        asked.set()
        name = book.start(cell, (campaign, checked_plan(cell, campaign)), "", lease)
        until(lambda: book.busy_with is None)
        rested = book.document(name)
        assert (rested["state"], rested["reason"]) == ("paused", "Paused on request.")
        asked.clear()
        monkeypatch.setattr(book, "compute", Slowly(workers))
        book.resume(name, cell, lease)
        begun = book._execution.begun if book._execution is not None else threading.Event()
        in_time = begun.wait

        def wait(seconds: float) -> bool:
            asked.set()
            return in_time(PATIENCE_S)

        monkeypatch.setattr(begun, "wait", wait)
        try:
            shown = book.document(name)
        finally:
            asked.set()
        assert shown["state"] in ("running", "succeeded")
        until(lambda: book.busy_with is None)
        assert book.document(name)["state"] == "succeeded"


@pytest.mark.skipif(os.name != "posix", reason="elsewhere an open file cannot be taken away")
def test_a_run_whose_folder_is_gone_is_found_paused_and_stopped(tmp_path: Path) -> None:
    """The run continues in memory, so a stop must not be answered with "no such run"."""
    cell = a_cell()
    bench = Bench(cell)
    told: list[dict[str, Any]] = []
    with (
        closing(Workers(1, waiting=0)) as workers,
        closing(RunManager(tmp_path / "runs", lambda _: devices_of(bench), workers, simulated=True)) as book,
    ):

        def take() -> None:
            (tmp_path / "runs").rename(tmp_path / "aside")
            name = str(book.busy_with)
            told.append(book.document(name))
            book.pause(name, by="anna")
            assert book.stop(name, by="anna") == []

        bench.faults[9] = take
        campaign = a_campaign(settle_s=0.0)
        name = book.start(cell, (campaign, checked_plan(cell, campaign)), "", LeaseDeadline("anna", 300.0))
        until(lambda: book.busy_with is None)
        assert told[0]["state"] == "running"
        assert bench.calls == 9
        for document in (book.document(name), *readable(book.ids(), book.document)):
            assert document["state"] == "paused"
            assert f"{name}/record.sqlite3" in document["reason"]
        book.pause(name, by="anna")
        assert book.stop(name, by="anna") == []
        (tmp_path / "aside").rename(tmp_path / "runs")
        book.stop(name, by="anna")
        assert book.document(name)["state"] == "stopped"
