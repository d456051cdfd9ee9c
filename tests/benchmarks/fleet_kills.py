"""Benchmark of lost or repeated work while worker, scheduler and database are killed.

It diagnoses thousands of data sets, once with an SQLite file and once with a PostgreSQL, which is also stopped and
started. Processes are real as in docs/howto/fleet.md, with TLS and the store's data sets. One data set in a
hundred is diagnosed (40 readings, one effect). The others hold no reading and are refused when they are read: this
is a job like any other for scheduler, claims and store. Every statement of a worker is also noted outside the
store, so that work done twice is detected.
"""

from __future__ import annotations

import os
import subprocess
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from dask import config

from fleet.diagnose import DatasetSource, DiagnosisOrder, EngineGone, ProgressCounts, diagnose_all, in_store
from fleet.store import Document, FleetStore, dataset_content, migrate
from tests.benchmarks.clock import line
from tests.fleet.diagnose.certificates import make_certificates
from tests.fleet.diagnose.noted import NOTED
from tests.fleet.diagnose.plant import address_in, as_in_the_manual, process, settings
from tests.fleet.diagnose.sets import bad, good
from tests.fleet.documents import BEGAN, ROBOT
from tests.fleet.postgres import Cluster

REAL = 100  # one data set of so many is diagnosed
START_S = 300.0


@dataclass
class Plant:
    """Scheduler and two workers.

    `files` are certificates and notes; `address` is that of the scheduler.
    """

    folder: Path
    files: dict[str, Path]
    address: str = ""
    scheduler: subprocess.Popen[str] | None = None
    worker: subprocess.Popen[str] | None = None

    @contextmanager
    def running(self, number: int) -> Iterator[None]:
        """The processes, for the time of the block."""
        said = self.folder / f"scheduler{number}.json"
        with ExitStack() as stack:
            words = as_in_the_manual("scheduler", self.files, "--port", "0", "--protocol", "tls")
            self.scheduler = stack.enter_context(process(*words, "--scheduler-file", str(said)))
            self.address = address_in(said, START_S)
            words = as_in_the_manual("worker", self.files, self.address, "--nthreads", "1", "--no-nanny")
            words += ["--preload", "tests.fleet.diagnose.noted"]
            noted = {NOTED: str(self.folder / "noted")}
            self.worker = stack.enter_context(process(*words, environment=noted))
            stack.enter_context(process(*words, environment=noted))
            yield


def run(count: int = 2000) -> bool:
    """Measure, print; whether everything is there, once, on both databases."""
    reached = _run(count, None)
    cluster = Cluster()
    try:
        return _run(count, cluster) and reached
    finally:
        cluster.end()


def _run(count: int, cluster: Cluster | None) -> bool:
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        url = f"sqlite:///{root}/plant.sqlite3" if cluster is None else cluster.database()
        migrate(url)
        sources = _put(url, root, count)
        plant = Plant(root, make_certificates(root / "tls"))
        order, began = DiagnosisOrder(url, "first"), time.monotonic()
        with config.set(settings(plant.files)):
            first = _killed(plant, order, sources)
            with plant.running(2):
                tally = _again(plant, replace(order, owner="second"), sources, cluster)
        elapsed = time.monotonic() - began
        with FleetStore.open(url) as store:
            last = store.work.results(order.task)
        said = Counter((root / "noted").read_text("utf-8").splitlines())
    again = sum(times - 1 for times in said.values())
    changed = len(first - {(each.job.data, each.content) for each in last})
    kind = "SQLite" if cluster is None else "PostgreSQL, stopped and started besides"
    print(
        f"{count} data sets, {kind}: worker and scheduler killed after {len(first)}; the second call did {tally.done}, "
        f"found {tally.found}; {elapsed:.0f} s elapsed, load {os.getloadavg()[0]:.1f}"
    )
    left = count - len({each.job.data for each in last})
    line("data sets without a result", str(left), "0", left == 0)
    line(
        "results that changed or are there twice", str(changed + len(last) - count + left), "0", changed == 0
    )
    # the one in hand of a killed worker, and of both when the database went
    line("computed twice, of which one result was kept", str(again), "<= 4", again <= 4)
    return left == changed == 0 and len(last) == count and again <= 4


def _killed(plant: Plant, order: DiagnosisOrder, sources: list[DatasetSource]) -> set[tuple[str, bytes]]:
    """Run one call and return the results that it has made.

    Its worker is killed after a quarter, and its scheduler after half.
    """
    with plant.running(1):
        assert plant.worker is not None
        assert plant.scheduler is not None
        worker, scheduler = plant.worker, plant.scheduler

        def kill(tally: ProgressCounts) -> None:
            if 4 * tally.done >= tally.total:
                worker.kill()
            if 2 * tally.done >= tally.total:
                scheduler.kill()

        try:
            diagnose_all(sources, order, print, kill, scheduler=plant.address)
        except EngineGone as error:
            print(f"the command says: {error}")
    with FleetStore.open(order.store) as store:
        return {(each.job.data, each.content) for each in store.work.results(order.task)}


def _again(
    plant: Plant, order: DiagnosisOrder, sources: list[DatasetSource], cluster: Cluster | None
) -> ProgressCounts:
    """Repeat the call, which does the remaining work.

    Its database is stopped in the middle, and started when that is reported.
    """
    gone: list[int] = []

    def stop(tally: ProgressCounts) -> None:
        if cluster is not None and not gone and tally.done:
            gone.append(tally.done)
            cluster.stop()

    def tell(sentence: str) -> None:
        print(f"the command says: {sentence}")
        if cluster is not None and "does not answer" in sentence:
            cluster.start()

    tally = diagnose_all(sources, order, tell, stop, scheduler=plant.address)
    assert cluster is None or gone
    return tally


def _put(url: str, folder: Path, count: int) -> list[DatasetSource]:
    documents = []
    for i in range(count):
        data = (bad if i % REAL else good)(folder, f"set{i}")
        content = dataset_content(data.read_text("utf-8"), data.with_suffix(".toml").read_text("utf-8"))
        documents.append(Document("dataset", ROBOT, "cell-1", f"set{i}", BEGAN, content))
    with FleetStore.open(url) as store:
        store.add_all(documents)
        return in_store(store)
