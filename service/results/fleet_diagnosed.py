"""Diagnosis of many data sets, for documents (`truepose-fleet-run/1`) and terminal tables."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from datetime import datetime
from os import getpid
from pathlib import Path
from socket import gethostname
from statistics import median
from typing import Any

from calib.errors import DataError
from fleet.diagnose import (
    REFUSED,
    DiagnosisOrder,
    ProgressCounts,
    VersionComparison,
    VersionDifference,
    VersionStatement,
    changes_between,
    diagnose_all,
    for_workers,
    in_files,
    in_store,
    named,
)
from fleet.store import FleetStore, JobResult, utc_now
from service.wording import counted

FORMAT = "truepose-fleet-run/1"


@dataclass(frozen=True)
class FleetDiagnosisRequest:
    """Request for a diagnosis of many data sets.

    Attributes
    ----------
    data
        Files and folders; empty for the data sets of the store.
    workers
        Number of processes on this computer; None for one per processor.
    scheduler
        Address of a scheduler; empty for this computer.
    most
        Maximum number of effects per data set.
    since
        Version of TruePose with which to compare; empty for none.
    """

    data: tuple[Path, ...]
    store: str
    workers: int | None
    scheduler: str
    most: int
    since: str


@dataclass(frozen=True)
class FleetDiagnosed:
    """Outcome of a request. `tables` holds the results of its data sets, in their order."""

    place: str
    program: str
    tally: ProgressCounts
    tables: tuple[dict[str, Any], ...]
    changes: VersionComparison | None

    @classmethod
    def of(
        cls,
        asked: FleetDiagnosisRequest,
        say: Callable[[str], None],
        tell: Callable[[str], None],
        progress: Callable[[ProgressCounts], None],
    ) -> FleetDiagnosed:
        """Diagnose the data sets that have no result yet.

        Parameters
        ----------
        say : callable
            Called with each step.
        tell : callable
            Called with sentences about workers.
        progress : callable
            Called with the counts after each batch.

        Raises
        ------
        DataError
            There is no data set, or no such version.
        EngineGone
            There is no scheduler, or no worker of the same build.
        StoreError
            The store cannot be used.
        """
        address = for_workers(asked.store, asked.scheduler)
        owner = f"{gethostname()} {getpid()} {utc_now():%Y-%m-%dT%H:%M:%S}"
        with FleetStore.open(address) as store:
            order = DiagnosisOrder(address, owner, asked.most)
            versions = []
            if asked.since:  # refused before the work, not after it
                versions = named(asked.since, store.work.programs(order.task), order.expected)
            say("listing data sets")
            sources = in_files(asked.data) if asked.data else in_store(store)
            if not sources:
                raise DataError("holds no data set.", do="Send some, or name files.", file=store.place)
            jobs = {order.job(source): source for source in sources}
            done = store.work.done(list(jobs))
            say(f"{counted(len(jobs), 'data set')}, {len(done)} with a result of this version")
            todo = [source for job, source in jobs.items() if job not in done]
            tally = diagnose_all(
                todo, order, tell, progress, workers=asked.workers, scheduler=asked.scheduler
            )
            tally.total, tally.known = len(jobs), len(done)
            found = {each.job: each for each in store.work.results(order.task, program=order.expected)}
            results = [found[job] for job in jobs if job in found]
            compared = None
            if asked.since:
                before = [
                    each for version in versions for each in store.work.results(order.task, program=version)
                ]
                before.sort(key=_finished)
                compared = changes_between(before, results, order.expected)
            tables = tuple(json.loads(each.content) for each in results)
            return cls(store.place, order.expected, tally, tables, compared)

    @property
    def refused(self) -> list[dict[str, Any]]:
        """Results of data sets that cannot be used."""
        return [table for table in self.tables if table["verdict"] == REFUSED]

    @property
    def verdicts(self) -> list[tuple[str, int, float | None, float | None]]:
        """Rows by verdict, the most frequent first.

        A row holds the verdict, the number of data sets, and the median held-out errors, mm, of the base model and with
        effects.
        """
        rows = []
        for verdict, count in Counter(table["verdict"] for table in self.tables).most_common():
            of_it = [table for table in self.tables if table["verdict"] == verdict]
            rows.append((verdict, count, _median(of_it, "error_before_mm"), _median(of_it, "error_after_mm")))
        return rows

    def document(self) -> dict[str, Any]:
        """Return the outcome as a JSON document."""
        tally = self.tally
        return {
            "format": FORMAT,
            "program": self.program,
            "store": self.place,
            "data_sets": tally.total,
            "had_a_result": tally.known,
            "done": tally.done,
            "done_by_others": tally.found,
            "computed_in_vain": tally.twice,
            "refused": [
                {key: table[key] for key in ("name", "what", "do", "line", "key")} for table in self.refused
            ],
            "failed": [{"name": name, "why": why} for name, why in tally.failed.items()],
            "verdicts": {verdict: count for verdict, count, *_ in self.verdicts},
            "processor_seconds": round(tally.seconds, 3),
            "overhead_seconds": round(tally.overhead_s, 3),
            "start_seconds": round(tally.start_s, 3),
            "seconds": round(tally.elapsed, 3),
            "workers": tally.workers,
            "workers_lost": tally.lost,
            "changes": None if self.changes is None else _changes(self.changes),
        }


def _finished(result: JobResult) -> datetime:
    return result.finished_at


def _median(tables: Sequence[dict[str, Any]], key: str) -> float | None:
    """Return the median RMS of an error, or None if no table has it."""
    values = [table[key]["rms"] for table in tables if table.get(key)]
    return median(values) if values else None


def _changes(found: VersionComparison) -> dict[str, Any]:
    return {
        "since": list(found.since),
        "compared": found.compared,
        "missing": found.missing,
        "median_ratio_of_held_out_errors": found.ratio,
        "changed": [_change(each) for each in found.changed],
    }


def _change(each: VersionDifference) -> dict[str, Any]:
    return {
        "data": each.data,
        "name": each.name,
        "was": _side(each.was),
        "now": _side(each.now),
        "gone": each.gone,
        "new": each.new,
        "resized": each.resized,
        "ratio": each.ratio,
    }


def _side(side: VersionStatement) -> dict[str, Any]:
    table = asdict(side)
    table["effects"] = [
        {"label": label, "value": value, "std": std, "unit": unit}
        for label, (value, std, unit) in side.effects.items()
    ]
    return table
