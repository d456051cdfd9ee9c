"""Many data sets by two local workers against one: elapsed time, processor time, what the scheduler costs.

2,000 data sets of 1,000 readings are wanted; so many of them as the count says are measured, and the rest follows from
the price of one. Both runs are made of the same data sets, one after the other, each into a store of its own. Elapsed
times tell of the neighbours on a busy machine, so processor times and the load stand beside them.
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from fleet.diagnose import Order, Tally, diagnose_all, in_files
from fleet.store import Store
from mocks.campaign import make_campaign, write_campaign
from tests.benchmarks.clock import line

READINGS, WANTED = 1000, 2000
FASTER, OVERHEAD = 1.9, 0.05


def run(count: int = 40) -> bool:
    """Measure, print; whether two workers are so much faster and the scheduler so cheap."""
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        for i in range(count):
            campaign = make_campaign(
                seed=i + 1, n=READINGS, n_validation=100, effects=["backlash:j4"], size=4.0
            )
            write_campaign(campaign, root / "data" / f"{i:04d}")
        began = time.perf_counter()
        sources = in_files([root / "data"])
        hashed = (time.perf_counter() - began) / count
        tallies = {}
        for workers in (1, 2):
            order = Order(f"sqlite:///{root}/{workers}.sqlite3", f"{workers}")
            tallies[workers] = tally = diagnose_all(sources, order, print, _quiet, workers=workers)
            with Store.open(order.store) as store:
                results = store.work.results(order.task)
            assert len(results) == tally.done == count
            print(
                f"{workers} workers: {tally.elapsed:.1f} s elapsed, {tally.seconds:.1f} s of processor time in "
                f"diagnoses ({tally.seconds / count:.3f} s each), scheduler and command {tally.overhead_s:.2f} s, "
                f"{tally.batches} batches, load {os.getloadavg()[0]:.1f}"
            )
        size = sum(len(each.content) for each in results) / count
        print(f"{size:.0f} bytes a result, {1e3 * hashed:.1f} ms to hash a data set")
        one, two = tallies[1], tallies[2]
        print(
            f"{WANTED} data sets: {WANTED * two.seconds / count / 60:.0f} min of processor time, "
            f"{WANTED * two.elapsed / count / 60:.0f} min elapsed at 2 workers under this load"
        )
        faster, over = one.elapsed / two.elapsed, two.overhead_s / two.seconds
        line("elapsed, one worker over two", f"{faster:.2f}", f">= {FASTER}", faster >= FASTER)
        line("scheduler and command over work", f"{over:.1%}", f"<= {OVERHEAD:.0%}", over <= OVERHEAD)
        return faster >= FASTER and over <= OVERHEAD


def _quiet(_: Tally) -> None:
    """The progress of a bench is its end."""
