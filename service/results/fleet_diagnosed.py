"""Diagnosis of many data sets (`truepose-fleet-run/1`)."""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import datetime
from os import getpid
from pathlib import Path
from socket import gethostname
from statistics import median
from typing import Annotated, Any, Literal, Self

from calib.errors import DataError
from fleet.diagnose import (
    REFUSED,
    DiagnosisOrder,
    ProgressCounts,
    VersionComparison,
    VersionStatement,
    changes_between,
    diagnose_all,
    for_workers,
    in_files,
    in_store,
    named,
)
from fleet.store import FleetStore, JobResult, utc_now
from service.results.common import ERRORS, Figure
from service.results.shape import ResponseBody, told
from service.wording import counted


class RefusedDataset(ResponseBody):
    """A data set that cannot be used."""

    name: Annotated[str, told("Its name.", "b.csv")]
    what: Annotated[str, told("What is wrong.", "column 'j1_deg' is missing.")]
    do: Annotated[str, told("What to do.", "Give j1_deg to j6_deg.")]
    line: Annotated[int | None, told("Number of the line; null if it is not known.", 12)]
    key: Annotated[str | None, told("The key; null if it is not known.", "noise.kind")]


class FailedDataset(ResponseBody):
    """A data set without a result."""

    name: Annotated[str, told("Its name.", "c.csv")]
    why: Annotated[str, told("Why.", "its worker was lost")]


class StatedEffect(Figure):
    """An effect as a version found it."""

    label: Annotated[str, told("Its label.", "backlash:j4")]


class VersionStatementResponse(ResponseBody):
    """The statement of one version on a data set."""

    verdict: Annotated[str, told("The verdict, or refused.", "attributed")]
    effects: Annotated[list[StatedEffect], told("Every effect.", [])]
    rms: Annotated[float | None, told("RMS error on readings held out, mm; null without any.", ERRORS["rms"])]

    @classmethod
    def of(cls, said: VersionStatement) -> Self:
        """Describe the statement of a version."""
        effects = [
            StatedEffect(label=label, value=value, std=std, unit=unit)
            for label, (value, std, unit) in said.effects.items()
        ]
        return cls(verdict=said.verdict, effects=effects, rms=said.rms)


class VersionDifferenceResponse(ResponseBody):
    """A data set with different results of two versions."""

    data: Annotated[str, told("Hash of the data set.", "a93c6fe109b1ae11")]
    name: Annotated[str, told("Its name.", "a.csv")]
    was: Annotated[
        VersionStatementResponse, told("What the version before said.", {"verdict": "unexplained"})
    ]
    now: Annotated[VersionStatementResponse, told("What this version says.", {"verdict": "attributed"})]
    gone: Annotated[list[str], told("Labels of effects that are no longer found.", [])]
    new: Annotated[list[str], told("Labels of effects that were not found before.", ["backlash:j4"])]
    resized: Annotated[list[str], told("Labels of effects of another size.", [])]
    ratio: Annotated[float | None, told("Held-out error now over before, a ratio; null without both.", 0.4)]


class VersionComparisonResponse(ResponseBody):
    """The results of this version, compared with those of another one."""

    since: Annotated[list[str], told("The builds that it is compared with.", ["0.0.9+3f9a1c07b2e4"])]
    compared: Annotated[int, told("Number of data sets that both have judged.", 120)]
    missing: Annotated[int, told("Number of those that only this version has judged.", 3)]
    median_ratio_of_held_out_errors: Annotated[
        float | None, told("Median of the errors now over before, a ratio; null without any.", 0.98)
    ]
    changed: Annotated[list[VersionDifferenceResponse], told("Those with differences, worst first.", [])]

    @classmethod
    def of(cls, found: VersionComparison) -> Self:
        """Describe the comparison of two versions."""
        same = ("data", "name", "gone", "new", "resized", "ratio")
        return cls(
            since=list(found.since),
            compared=found.compared,
            missing=found.missing,
            median_ratio_of_held_out_errors=found.ratio,
            changed=[
                VersionDifferenceResponse(
                    **{name: getattr(each, name) for name in same},
                    was=VersionStatementResponse.of(each.was),
                    now=VersionStatementResponse.of(each.now),
                )
                for each in found.changed
            ],
        )


class FleetRunResult(ResponseBody):
    """A diagnosis of many data sets (`truepose-fleet-run/1`)."""

    format: Annotated[Literal["truepose-fleet-run/1"], told("The format.", "truepose-fleet-run/1")]
    program: Annotated[str, told("The build of this version.", "0.1.0+3f9a1c07b2e4")]
    store: Annotated[str, told("Where the results are kept.", "sqlite:///fleet.sqlite3")]
    data_sets: Annotated[int, told("Number of data sets.", 123)]
    had_a_result: Annotated[int, told("Number of those with a result of this version before.", 100)]
    done: Annotated[int, told("Number of those that were diagnosed now, refused ones included.", 20)]
    done_by_others: Annotated[int, told("Number of those that another call had done meanwhile.", 1)]
    computed_in_vain: Annotated[int, told("Number of those for which another result came first.", 0)]
    refused: Annotated[list[RefusedDataset], told("Those that cannot be used.", [])]
    failed: Annotated[list[FailedDataset], told("Those without a result.", [])]
    verdicts: Annotated[
        dict[str, int], told("Number of data sets by verdict, most frequent first.", {"attributed": 80})
    ]
    processor_seconds: Annotated[float, told("Processor time of the diagnoses, s.", 61.2)]
    overhead_seconds: Annotated[
        float, told("Processor time of the command while data sets were distributed, s.", 1.3)
    ]
    start_seconds: Annotated[float, told("Processor time of the command before and after that, s.", 2.1)]
    seconds: Annotated[float, told("Time since the workers were available, s.", 35.0)]
    workers: Annotated[int, told("Number of workers.", 2)]
    workers_lost: Annotated[int, told("Number of workers that were lost.", 0)]
    changes: Annotated[VersionComparisonResponse | None, told("Where another version was named.", None)]


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

    @property
    def result(self) -> FleetRunResult:
        """Outcome of the diagnosis, as reported."""
        tally = self.tally
        return FleetRunResult(
            format="truepose-fleet-run/1",
            program=self.program,
            store=self.place,
            data_sets=tally.total,
            had_a_result=tally.known,
            done=tally.done,
            done_by_others=tally.found,
            computed_in_vain=tally.twice,
            refused=[
                RefusedDataset(**{key: table[key] for key in RefusedDataset.model_fields})
                for table in self.tables
                if table["verdict"] == REFUSED
            ],
            failed=[FailedDataset(name=name, why=why) for name, why in tally.failed.items()],
            verdicts={verdict: count for verdict, count, *_ in self.verdicts},
            processor_seconds=round(tally.seconds, 3),
            overhead_seconds=round(tally.overhead_s, 3),
            start_seconds=round(tally.start_s, 3),
            seconds=round(tally.elapsed, 3),
            workers=tally.workers,
            workers_lost=tally.lost,
            changes=None if self.changes is None else VersionComparisonResponse.of(self.changes),
        )


def _finished(result: JobResult) -> datetime:
    return result.finished_at


def _median(tables: Sequence[dict[str, Any]], key: str) -> float | None:
    """Return the median RMS of an error, or None if no table has it."""
    values = [table[key]["rms"] for table in tables if table.get(key)]
    return median(values) if values else None
