"""Another robot at the address of a run.

The service refuses it, and accepts it by its serial number with a reason.
"""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from acquisition import Cell, Devices, LeaseDeadline, checked_plan
from acquisition.record.device_serials import DeviceAcceptance
from service.cli import main
from service.http.routes.runs.run_routes import acceptance
from service.http.runs.run_manager import RunManager
from service.http.wire.bodies import DatasetExportRequest, Resume
from service.http.work.datasets import DatasetStore
from service.http.work.workers import Workers
from tests.acquisition.fakes import Bench, SeatingOperator, a_campaign, a_cell, devices_of
from tests.drivers.waiting import until

BLOCKS = [{"set": "calibration", "count": 12, "targets": ["T1", "T2"]}]


def ended(book: RunManager, name: str) -> dict[str, Any]:
    until(lambda: book.busy_with is None)
    return book.document(name)


def test_a_run_of_the_service(tmp_path: Path) -> None:
    cell = a_cell(simulation={"time_scale": 1000.0})
    bench, lease = Bench(cell), LeaseDeadline("anna", 3600.0)

    def open_devices(_: Cell) -> Devices:
        return devices_of(bench, SeatingOperator(bench))

    with (
        closing(Workers(1, waiting=0)) as workers,
        closing(RunManager(tmp_path / "runs", open_devices, workers, simulated=True)) as book,
    ):
        bench.faults[16] = lambda: book.pause(str(book.busy_with), by="anna")
        campaign = a_campaign(block=BLOCKS, settle_s=0.0)
        name = book.start(cell, (campaign, checked_plan(cell, campaign)), "", lease)
        assert ended(book, name)["state"] == "paused"
        bench.who["robot"] = replace(bench.who["robot"], serial="777777")
        bench.log.clear()
        book.resume(name, cell, lease)
        refused = ended(book, name)
        assert refused["state"] == "paused"
        assert refused["error"]["name"] == "OtherIndividual"
        assert refused["error"]["serial"] == "777777"
        assert "777777" in refused["reason"]
        assert not [call for call in bench.log if call.startswith(("arm", "move"))]
        body = Resume(accept_other="777777", reason="arm replaced")
        book.resume(name, cell, lease, acceptance(body, "anna"))
        assert ended(book, name)["state"] == "succeeded"
        dataset = DatasetStore(tmp_path / "datasets").export([book.path(name)], "")
        assert [each["reason"] for each in dataset["devices"] if each["serial"] == "777777"] == [
            "arm replaced"
        ]


@pytest.mark.parametrize("body", [Resume, DatasetExportRequest])
def test_one_without_the_other_is_refused(body: type[Resume]) -> None:
    assert acceptance(body(), "anna") is None
    assert acceptance(body(accept_other="7", reason="why"), "anna") == DeviceAcceptance("7", "why", "anna")
    for given in ({"accept_other": "7"}, {"reason": "why"}, {"accept_other": "7", "reason": " "}):
        with pytest.raises(ValidationError, match="both accept_other and reason"):
            body(**given)


@pytest.mark.parametrize("command", [["resume", "DIR"], ["export", "DIR", "out.csv"]])
@pytest.mark.parametrize("given", [["--accept-other", "7"], ["--reason", "why"]])
def test_at_the_command_line_too(
    command: list[str], given: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = [str(tmp_path) if word == "DIR" else word for word in command]
    assert main(["campaign", *line, *given]) == 2
    assert "one of which is missing" in capsys.readouterr().err
