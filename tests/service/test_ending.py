"""The service ends during heavy work: promptly, its run paused, no process left behind.

These would catch: a service that finishes a dry run before it ends, and clients that are never answered. They would
also catch worker processes that outlive the service, even if it was killed and could not end them.
"""

from __future__ import annotations

import os
import signal
import tomllib
from concurrent.futures import Future
from pathlib import Path
from typing import Any

import httpx2
import pytest

from acquisition import Devices, LeaseDeadline, checked_plan, read_status
from acquisition.errors import StorageError
from calib.errors import DataError
from service.http.runs import run_manager
from service.http.runs.run_manager import RunManager
from service.http.wire.problems import Problem
from service.http.work.workers import WorkerDied, Workers
from tests.acquisition.fakes import Bench, FakeMeter, a_campaign, a_cell
from tests.drivers.waiting import PATIENCE_S, in_thread, until
from tests.end_to_end.simulated import EXAMPLE, campaign_file, cell_file
from tests.processes import children_of, command_of
from tests.service.slow_arm import SlowArm
from tests.service.test_http_support import Served, problem, served

# Minutes of computing, over long before the test by being ended.
LONG: dict[str, Any] = {
    "format": "truepose-campaign/1",
    "block": [{"set": "calibration", "count": 800, "select": "observability"}],
}
linux = pytest.mark.skipif(not Path("/proc").is_dir(), reason="processes are counted in /proc")


def workers_of(pid: int) -> list[int]:
    """Worker processes of a service."""
    return [child for child in children_of(pid) if "service.worker" in command_of(child)]


def computing(pid: int) -> bool:
    """A worker that has its modules loaded and is at work."""
    seconds = sum(
        map(int, Path(f"/proc/{pid}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[11:13])
    )
    return seconds / os.sysconf("SC_CLK_TCK") > 2.0


def ask_much(service: Served, count: int) -> list[Future[httpx2.Response]]:
    return [in_thread(lambda: service.client.post("/runs", json={"campaign": LONG})) for _ in range(count)]


@linux
def test_it_ends_promptly_with_its_run_paused_and_its_workers_gone(tmp_path: Path) -> None:
    cell = cell_file(tmp_path, time_scale=1.0)
    campaign = tomllib.loads(campaign_file(tmp_path, warm_up_s=600.0).read_text("utf-8"))
    with served(tmp_path / "record", "--cell", str(cell), "--simulate") as service:
        run = service.begin(campaign)
        asked = ask_much(service, 2)
        until(lambda: len(workers_of(service.process.pid)) == 2)
        workers = workers_of(service.process.pid)
        service.until(f"/runs/{run}", "running")
        nohup = signal.getsignal(signal.SIGHUP) is signal.SIG_IGN  # what it starts ignores a hang-up too
        service.process.send_signal(signal.SIGTERM if nohup else signal.SIGHUP)
        assert service.process.wait(PATIENCE_S) == 0
        assert not any(Path(f"/proc/{pid}").exists() for pid in workers)
        for each in asked:
            assert problem(each.result(PATIENCE_S), 503)["code"] == 8122
    status = read_status(tmp_path / "record" / "runs" / run)
    assert (status.state, status.reason) == ("paused", "The service was ended.")


@linux
def test_its_workers_end_when_it_is_killed(tmp_path: Path) -> None:
    with served(tmp_path / "record", "--cell", str(EXAMPLE / "cell.toml")) as service:
        asked = ask_much(service, 2)
        pid = service.process.pid
        until(lambda: len(workers_of(pid)) == 2 and all(map(computing, workers_of(pid))))
        workers = workers_of(pid)
        service.process.kill()
        service.process.wait()
        until(lambda: not any(Path(f"/proc/{worker}").exists() for worker in workers))
        for each in asked:
            assert isinstance(each.exception(PATIENCE_S), httpx2.TransportError)


def test_a_long_move_is_halted_and_the_run_paused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(run_manager, "PAUSE_S", 0.05)
    monkeypatch.setattr(run_manager, "REST_S", 0.05)
    bench = Bench(a_cell())
    arm = SlowArm(bench)
    workers = Workers(1, waiting=0)
    runs = RunManager(tmp_path, lambda _: Devices(arm, FakeMeter(bench)), workers, simulated=True)
    campaign = a_campaign(settle_s=0.0)
    plan = campaign, checked_plan(bench.cell, campaign)
    run = runs.start(bench.cell, plan, "night", LeaseDeadline("anna", 300.0))
    assert arm.moving.wait(PATIENCE_S)
    workers.close()
    runs.close()
    assert arm.halted.is_set()
    status = read_status(tmp_path / run)
    assert (status.state, status.reason) == ("paused", "The service was ended.")
    with pytest.raises(Problem, match="being ended"):
        runs.start(bench.cell, plan, "another", LeaseDeadline("anna", 300.0))


# -- workers ----------------------------------------------------------------------------------------------------


def _refuse(line: int) -> None:
    raise DataError("is bad.", do="Mend it.", file="a.csv", line=line, key="x_mm")


def test_refusals_come_back_whole_and_a_worker_that_dies_is_replaced() -> None:
    workers = Workers(1, waiting=0)
    try:
        assert workers.call(divmod, 7, 2) == (3, 1)
        first = workers.call(os.getpid)
        with pytest.raises(DataError) as refused:
            workers.call(_refuse, 3)
        assert (refused.value.line, refused.value.key, refused.value.do) == (3, "x_mm", "Mend it.")
        assert str(refused.value) == "a.csv, line 3, key 'x_mm': is bad. Mend it."
        with pytest.raises(StorageError, match="nowhere: No such file") as unwritten:
            workers.call(os.listdir, "/nowhere")
        assert "Make room" in unwritten.value.what_to_do
        assert workers.call(os.getpid) == first
        with pytest.raises(WorkerDied):
            workers.call(os._exit, 1)
        assert workers.call(os.getpid) != first
    finally:
        workers.close()
    with pytest.raises(Problem, match="being ended"):
        workers.call(os.getpid)


@linux
def test_more_calls_than_may_wait_are_refused(tmp_path: Path) -> None:
    workers, pipe = Workers(1, waiting=1), tmp_path / "pipe"
    os.mkfifo(pipe)
    try:
        busy = in_thread(lambda: workers.call(Path.read_bytes, pipe))  # until somebody writes
        until(lambda: workers._busy)
        waits = in_thread(lambda: workers.call(os.getpid))
        until(lambda: workers._waiting)
        with pytest.raises(Problem) as refused:
            workers.call(os.getpid)
        assert (refused.value.status_code, refused.value.code) == (503, 8120)
        pipe.write_bytes(b"done")
        assert busy.result(PATIENCE_S) == b"done"
        assert waits.result(PATIENCE_S) > 0
    finally:
        workers.close()


@linux
def test_the_end_refuses_what_is_computed_and_what_waits(tmp_path: Path) -> None:
    workers, pipe = Workers(1, waiting=1), tmp_path / "pipe"
    os.mkfifo(pipe)
    calls = [in_thread(lambda: workers.call(Path.read_bytes, pipe)) for _ in range(2)]
    until(lambda: workers._busy and workers._waiting)
    workers.close()
    for each in calls:
        with pytest.raises(Problem, match="being ended"):
            each.result(PATIENCE_S)
