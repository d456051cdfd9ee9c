"""Data sets diagnosed by real processes, while workers and schedulers are killed."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import psutil
import pytest
from distributed import Client, Worker, WorkerPlugin

from fleet.diagnose import DatasetSource, DiagnosisOrder, ProgressCounts, batch, in_files, this_program
from fleet.diagnose.engine import local
from fleet.diagnose.run import FleetRun
from fleet.store import FleetStore
from tests.drivers import waiting
from tests.fleet.diagnose.noted import Noting
from tests.fleet.diagnose.sets import bad, good

pytestmark = pytest.mark.usefixtures("patient")


class Deadly(Noting):
    """A data set of the name "deadly" ends its worker."""

    def of_refusal(self, name: str, error: Any) -> Any:
        """Kill the worker for a deadly data set; otherwise as `statement.of_refusal`."""
        if "deadly" in name:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().of_refusal(name, error)


class Noted(WorkerPlugin):
    """Every statement that a worker makes is noted in a file."""

    name = "noted"

    def __init__(self, file: Path) -> None:
        self.file = file

    def setup(self, worker: Worker) -> None:
        """Runs on every worker, also on those that come later."""
        batch.statement = Deadly(self.file)  # type: ignore[assignment]


@pytest.fixture(scope="module")
def client() -> Iterator[Client]:
    """Two workers of this computer."""
    with local(2) as client:
        yield client


@pytest.fixture
def order(tmp_path: Path) -> DiagnosisOrder:
    order = DiagnosisOrder(f"sqlite:///{tmp_path}/s.sqlite3", "this call", most=1, lease_s=5.0)
    FleetStore.open(order.store).close()  # before workers come to it together
    return order


def some(folder: Path, goods: int, bads: int) -> list[DatasetSource]:
    files = [good(folder, f"good{i}") for i in range(goods)] + [bad(folder, f"bad{i}") for i in range(bads)]
    return in_files(files)


def run(
    client: Client,
    order: DiagnosisOrder,
    sources: list[DatasetSource],
    progress: Callable[[ProgressCounts], None] | None = None,
) -> tuple[ProgressCounts, list[str], Counter[str]]:
    """Run a diagnosis, and return the tally, the messages, and the statements per data set."""
    noted = Path(order.store.removeprefix("sqlite:///")).with_name("noted")
    noted.touch()
    client.register_plugin(Noted(noted))
    told: list[str] = []
    tally = FleetRun(client, order, sources, told.append).run(progress or (lambda _: None))
    return tally, told, Counter(noted.read_text("utf-8").split())


def kept(order: DiagnosisOrder) -> int:
    with FleetStore.open(order.store) as store:
        return len(store.work.results(order.task, program=order.expected))


def test_every_data_set_is_done_once_and_only_here(
    client: Client, order: DiagnosisOrder, tmp_path: Path
) -> None:
    sources = some(tmp_path, 2, 20)
    tally, told, said = run(client, order, sources)
    assert (tally.done, tally.refused, tally.twice, tally.failed, tally.left) == (22, 20, 0, {}, 0)
    assert kept(order) == 22
    assert told == []
    assert set(said.values()) == {1}
    assert tally.batches < 22  # many in one
    again, _, said_again = run(client, order, sources)
    assert (again.done, again.found) == (0, 22)
    assert said_again == said
    here = psutil.Process()
    listening = [
        each.laddr.ip
        for process in (here, *here.children(recursive=True))
        for each in process.net_connections("tcp")
        if each.status == psutil.CONN_LISTEN
    ]
    assert set(listening) == {"127.0.0.1"}
    assert client.scheduler_info()["address"].startswith("tls://127.0.0.1:")
    threads: Any = client.run(os.environ.get, "OPENBLAS_NUM_THREADS")
    assert set(threads.values()) == {"1"}


def test_a_killed_worker_loses_nothing(client: Client, order: DiagnosisOrder, tmp_path: Path) -> None:
    pids: Any = client.run(os.getpid)
    address, pid = next(iter(pids.items()))
    killed: list[int] = []

    def kill(tally: ProgressCounts) -> None:
        if not killed:
            killed.append(pid)
            os.kill(pid, signal.SIGKILL)
            waiting.until(lambda: address not in client.scheduler_info(n_workers=-1)["workers"])

    tally, told, said = run(client, order, some(tmp_path, 1, 23), kill)
    assert tally.left == 0
    assert tally.done + tally.found == kept(order) == 24
    assert (tally.twice, tally.failed) == (0, {})
    assert len(said) == 24
    assert sum(said.values()) <= 25  # what was computed and not yet kept when its worker was killed
    assert tally.lost == 1
    assert any("is lost: its data sets go to others" in each for each in told)


def test_what_ends_its_worker_or_has_changed_is_named_and_stops_no_other(
    client: Client, order: DiagnosisOrder, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    cluster: Any = client.cluster
    monkeypatch.setattr(cluster.scheduler, "allowed_failures", 0)  # every death takes a start of seconds
    sources = [*in_files([bad(tmp_path, "deadly")]), *some(tmp_path, 0, 5)]
    Path(sources[1].path).write_text("others now", "utf-8")
    tally, _, said = run(client, order, sources)
    assert (tally.left, tally.done) == (0, 4)
    assert sorted(tally.failed) == sorted(each.name for each in sources[:2])
    assert "its worker ended each time" in tally.failed[sources[0].name]
    assert "changed since" in tally.failed[sources[1].name]
    assert kept(order) == len(said) == 4
    assert this_program() == order.expected


CALL = """
from fleet.diagnose.engine import local

if __name__ == "__main__":
    with local(1) as client:
        print(client.submit(sum, [40, 2]).result())
"""


def test_what_lies_in_the_folder_of_the_user_is_not_executed_by_workers(tmp_path: Path) -> None:
    program, here = tmp_path / "program", tmp_path / "here"
    for folder in (program, here):
        folder.mkdir()
    (program / "call.py").write_text(CALL, "utf-8")
    for name in ("pickle", "json", "fleet"):
        (here / f"{name}.py").write_text("raise SystemExit('executed')\n", "utf-8")
    command = [sys.executable, str(program / "call.py")]
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[3]), "PYTHONSAFEPATH": ""}
    done = subprocess.run(
        command,
        cwd=here,
        env=environment,
        capture_output=True,
        text=True,
        timeout=waiting.PATIENCE_S,
        check=False,
    )
    assert done.stdout == "42\n", done.stderr
