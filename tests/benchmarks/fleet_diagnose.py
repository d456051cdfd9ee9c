"""Benchmark of fleet diagnosis: two local workers against one, and the scheduling overhead.

Elapsed times depend on the other load of a busy machine, so the processor time of every process is printed as well.
It gives the time of two workers on two processors that they have for themselves. A diagnosis may cost more in the
second run, for example with shared caches. That is a property of the machine: elapsed times contain it, but the
ratio by processor time counts a diagnosis alike in both runs.

Waiting costs processor time per second. It is measured before the work and subtracted for the seconds that other
processes took. The start of the call is separate: it is paid once, for four data sets or for a hundred thousand.

The data sets have one of eight gear errors each. Beyond eight, a remark in the header makes a new data set that
costs the same work. Every run has a separate store.
"""

from __future__ import annotations

import os
import tempfile
import threading
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from distributed import Client

from fleet.diagnose import DatasetSource, DiagnosisOrder, ProgressCounts, in_files
from fleet.diagnose.engine import local
from fleet.diagnose.run import FleetRun
from fleet.store import FleetStore
from mocks.campaign import make_campaign, write_campaign
from tests.benchmarks.clock import line

READINGS, HELD_OUT, KINDS = 1000, 100, 8
WANTED = 2000  # data sets
FASTER, OVERHEAD = 1.9, 0.05
WAIT_S = 10.0  # without work


@dataclass(frozen=True)
class Spent:
    """Processor time of one run, s.

    `start_s` is that of all processes until the workers wait for work, `workers_s` that of each worker from then
    on. `tally.overhead_s` is that of scheduler and command. `command_idle` and `worker_idle` are the cost of
    waiting per second.
    """

    tally: ProgressCounts
    start_s: float
    workers_s: tuple[float, ...]
    bytes_each: float
    command_idle: float
    worker_idle: float

    @property
    def on_two_processors(self) -> float:
        """Return the time that these processes take on two free processors, s.

        It is that of work without any wait for a disk.
        """
        return max(*self.workers_s, (sum(self.workers_s) + self.tally.overhead_s) / 2.0, 0.0)

    @property
    def waited_s(self) -> float:
        """Seconds that the neighbours took."""
        return max(0.0, self.tally.elapsed - self.on_two_processors)


def run(count: int = 64, readings: int = READINGS) -> bool:
    """Measure and print; return whether both limits are met.

    Two workers must be fast enough, and the scheduler cheap enough.
    """
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        write_sets(root / "data", count, readings)
        began = time.process_time()
        sources = in_files([root / "data"])
        hashed = (time.process_time() - began) / count
        found = {workers: _measured(root, sources, workers) for workers in (1, 2)}
    for workers, spent in found.items():
        print(
            f"{count} data sets of {readings} readings, {workers} workers: {spent.tally.elapsed:.1f} s elapsed; "
            f"processor time: diagnoses {spent.tally.seconds:.1f} s, "
            f"workers {' + '.join(f'{each:.1f}' for each in spent.workers_s)} s, "
            f"scheduler and command {spent.tally.overhead_s:.2f} s in {spent.tally.batches} batches, "
            f"start {spent.start_s:.1f} s; load {os.getloadavg()[0]:.1f}"
        )
    one, two = found[1], found[2]
    dearer = two.tally.seconds / one.tally.seconds
    each = two.tally.seconds / count
    print(
        f"{each:.3f} s a data set, {1e3 * hashed:.1f} ms to hash one, {two.bytes_each:.0f} bytes a result, "
        f"{1e3 * two.tally.overhead_s / two.tally.batches:.1f} ms of scheduler and command a batch, "
        f"{1e3 * two.tally.overhead_s / two.tally.elapsed:.1f} ms a second (waiting {1e3 * two.command_idle:.1f}, a "
        f"worker {1e3 * two.worker_idle:.1f}); by two one costs {dearer:.2f} times as much"
    )
    print(
        f"{WANTED} data sets: {WANTED * each / 60:.0f} min of processor time, "
        f"{WANTED / count * two.on_two_processors / 60:.0f} min on two processors of their own, "
        f"{WANTED / count * two.tally.elapsed / 60:.0f} min elapsed under this load"
    )
    faster = one.tally.elapsed / two.tally.elapsed
    own = dearer * sum(one.workers_s) / two.on_two_processors
    over = (two.tally.overhead_s - two.waited_s * two.command_idle) / two.tally.seconds
    beside = (sum(two.workers_s) - 2.0 * two.waited_s * two.worker_idle) / two.tally.seconds - 1.0
    line("one worker over two, elapsed", f"{faster:.2f}", f">= {FASTER}", faster >= FASTER)
    line("one worker over two, by processor time", f"{own:.2f}", f">= {FASTER}", own >= FASTER)
    line("scheduler and command over work", f"{over:.1%}", f"<= {OVERHEAD:.0%}", over <= OVERHEAD)
    line(
        "... with what workers do beside it",
        f"{over + beside:.1%}",
        f"<= {OVERHEAD:.0%}",
        over + beside <= OVERHEAD,
    )
    return faster >= FASTER and own >= FASTER and over + beside <= OVERHEAD


def write_sets(folder: Path, count: int, readings: int) -> None:
    """Write `count` data sets; each differs by its header."""
    texts = []
    for seed in range(1, min(count, KINDS) + 1):
        campaign = make_campaign(
            seed=seed,
            n=readings,
            n_validation=max(readings // 10, HELD_OUT // 5),
            effects=["backlash:j4"],
            size=4.0,
        )
        data = Path(write_campaign(campaign, folder.with_name(f"kind{seed}"))["csv"])
        texts.append((data.read_text("utf-8"), data.with_suffix(".toml").read_text("utf-8")))
    folder.mkdir()
    for i in range(count):
        table, header = texts[i % len(texts)]
        (folder / f"{i:05d}.csv").write_text(table, "utf-8")
        (folder / f"{i:05d}.toml").write_text(f"# {i}\n{header}", "utf-8")


def _measured(root: Path, sources: list[DatasetSource], workers: int) -> Spent:
    order = DiagnosisOrder(f"sqlite:///{root}/{workers}.sqlite3", f"{workers}")
    FleetStore.open(order.store).close()
    began = time.process_time()
    with local(workers) as client:
        first = _processor_times(client)
        start_s = time.process_time() - began + sum(first.values())
        began = time.process_time()
        threading.Event().wait(WAIT_S)
        idle, before = time.process_time() - began, _processor_times(client)
        tally = FleetRun(client, order, sources, print).run(_quiet)
        after = _processor_times(client)
    assert not tally.failed
    with FleetStore.open(order.store) as store:
        results = store.work.results(order.task)
    assert len(results) == tally.done == len(sources)
    return Spent(
        tally,
        start_s,
        tuple(after[each] - before[each] for each in before),
        sum(len(each.content) for each in results) / len(results),
        idle / WAIT_S,
        (sum(before.values()) - sum(first.values())) / WAIT_S / workers,
    )


def _processor_times(client: Client) -> dict[str, float]:
    """The processor time of every worker, s. Asking imports the program there, as the enrolment of a worker does."""
    found: Any = client.run(_processor_time)
    return found


def _processor_time() -> float:
    import fleet.diagnose.batch  # noqa: F401

    return time.process_time()


def _quiet(_: ProgressCounts) -> None:
    """The progress of a bench is its end."""
