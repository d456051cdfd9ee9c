"""The history of a robot: what was measured and said of it, the trend of a parameter, when the next check is due.

Hours of use: what the counters of robots showed, from a table that a person or a PLC keeps.

Between two readings of a counter the robot is taken to have been used evenly; before the first and after the last
nobody knows.

The state of a robot by its history: what the last watch says, that a change is due now, and dates nobody can
believe.
"""

from __future__ import annotations

import json
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from itertools import groupby, pairwise
from pathlib import Path
from typing import Any

import numpy as np

from calib.errors import DataError
from calib.text import read_text, rows_of
from calib.upkeep import Check, ControlChart, Due, Method, chart_of, next_due
from fleet.store import (
    ERROR,
    LONGEST,
    AddResult,
    Document,
    DocumentSummary,
    FleetStore,
    RobotKey,
    RobotState,
    RobotSummary,
    TrendPoint,
    VerdictRecord,
)
from service.results.robot_answers import LineShown, TrendResponse, TrendValue, text_of

FORMAT = "truepose-history/1"
MOST = 100_000  # documents of one robot
_TOO_FEW = "One value makes no chart."
COLUMNS = ["serial", "at", "hours"]
CHANGED = ("changed", "ambiguous", "unexplained")
"""Verdicts after which somebody has to act, whatever the dates of checks say."""

_EARLIEST = datetime(2001, 1, 1, tzinfo=UTC)
"""Clocks whose battery is empty begin in 1970, 1980 or 2000."""

_AHEAD = timedelta(days=1)


def robot_of(store: FleetStore, serial: str, model: str | None) -> RobotKey:
    """The robot of a serial number; model: its type, where several types have that number. Raises DataError."""
    found = [each for each in store.named() if each.serial == serial]
    if model is not None:
        found = [each for each in found if each.model == model]
    if not found:
        raise DataError(
            f"has nothing of a robot '{serial}'.",
            do="truepose history robots lists those it has.",
            file=store.place,
        )
    if len(found) > 1:
        raise DataError(
            f"is of {' and of '.join(each.model for each in found)}.",
            do="Name its type with --model.",
            file=f"serial number {serial}",
        )
    return found[0]


@dataclass(frozen=True)
class HistoryLine:
    """A document of a robot, and what it said where it said something."""

    entry: DocumentSummary
    said: VerdictRecord | None
    error: TrendPoint | None

    @property
    def in_words(self) -> str:
        """The statement in a line."""
        words = []
        if self.said is not None:
            words.append(self.said.verdict)
            words += [cause.label for cause in self.said.causes]
        if self.error is not None:
            words.append(f"error {self.error.value:.3f} mm")
        return ", ".join(words)

    @property
    def shown(self) -> LineShown:
        """The line as it is answered."""
        entry, said = self.entry, self.said
        return LineShown.model_validate(
            {
                "measured": entry.measured_at,
                "kind": entry.kind,
                "cell": entry.cell,
                "identity": entry.identity,
                "document": entry.hash,
                "program": entry.program,
                "contradicts_another": entry.conflict,
                "verdict": None if said is None else said.verdict,
                "advice": None if said is None else said.advice,
                "in_words": "" if said is None else said.in_words,
                "causes": () if said is None else said.causes,
                "error_mm": self.error,
                "here": None,
            }
        )


def lines_of(store: FleetStore, robot: RobotKey) -> list[HistoryLine]:
    """All of a robot, oldest first."""
    said = {each.hash: each for each in store.verdicts(robot)}
    errors = {each.hash: each for each in store.trend(robot, ERROR, rediagnosed=False)}
    entries = reversed(store.documents(robot, limit=MOST))
    return [HistoryLine(each, said.get(each.hash), errors.get(each.hash)) for each in entries]


@dataclass(frozen=True)
class Trend:
    """The values of one parameter, oldest first, and their control chart; because: why there is none."""

    robot: RobotKey
    parameter: str
    unit: str
    points: tuple[TrendPoint, ...]
    chart: ControlChart | None
    because: str

    @classmethod
    def of(cls, robot: RobotKey, points: Sequence[TrendPoint]) -> Trend:
        """The trend of values of one parameter. Raises DataError for values in different units."""
        units = sorted({point.unit for point in points})
        if len(units) > 1:
            raise DataError(
                f"has values in {' and in '.join(units)}.",
                do="Look which program wrote them: truepose history show.",
                key=points[0].parameter,
            )
        chart, because = None, _TOO_FEW
        if len(points) > 1:
            try:
                chart, because = chart_of(checks_of(points)), ""
            except DataError as error:
                because = str(error)
        return cls(robot, points[0].parameter, units[0], tuple(points), chart, because)

    @property
    def signals(self) -> set[int]:
        """The values that lie outside, by index."""
        return set() if self.chart is None else {each.index for each in self.chart.signals}

    def shown(self, most: int = MOST) -> TrendResponse:
        """The trend as it is answered, with the newest values; the chart is that of all."""
        chart, signals = self.chart, self.signals
        limits = () if chart is None else chart.limits  # NaN for a value that alone is the reference
        values = [
            TrendValue(
                measured=text_of(point.measured_at),
                value=point.value,
                u=point.u,
                limits=limits[i].tolist() if i < len(limits) and np.isfinite(limits[i]).all() else None,
                signal=i in signals,
                document=point.hash,
                program=point.program,
                rediagnosed=point.rediagnosed,
            )
            for i, point in enumerate(self.points)
        ]
        return TrendResponse(
            parameter=self.parameter,
            unit=self.unit,
            centre=None if chart is None else chart.centre,
            values=values[-most:],
            signals=[] if chart is None else [each.because for each in chart.signals],
            no_chart_because=self.because,
            left_out=max(len(values) - most, 0),
        )


def trends_of(store: FleetStore, robot: RobotKey, parameter: str | None) -> list[Trend]:
    """The trends of a robot, of one parameter or of all, by name. Raises DataError for a parameter that it has not."""
    points = store.trend(robot, parameter)
    if not points:
        known = ", ".join(dict.fromkeys(point.parameter for point in store.trend(robot)))
        raise DataError(
            f"has no {'parameter' if parameter is None else f'{parameter!r}'} of the robot {robot.serial}.",
            do=f"There are {known}." if known else "Put a model of it in: truepose history add MODEL.json",
            file=store.place,
        )
    return trends_in(robot, points)


def trends_in(robot: RobotKey, points: Sequence[TrendPoint]) -> list[Trend]:
    """The trends of values that stand by name and time. Raises DataError as `Trend.of`."""
    by_name = groupby(points, key=lambda point: point.parameter)
    return [Trend.of(robot, list(each)) for _, each in by_name]


@dataclass(frozen=True)
class NextCheck:
    """A robot and its next check; said: what a watch said last; error: its last value; because: why, or why no date
    can be given."""

    known: RobotSummary
    said: VerdictRecord | None
    error: TrendPoint | None
    due: Due | None
    because: str

    def overdue(self, now: datetime) -> bool:
        """Whether the date has passed, or the robot was never checked."""
        return self.due is not None and self.due.date <= now


def due_of(store: FleetStore, method: Method, now: datetime, hours: Hours | None = None) -> list[NextCheck]:
    """The date at which each robot is to be checked next, now where it has changed; those first that are due first,
    and those that are retired not at all.
    hours: of use, for a method that goes by them."""
    out = []
    for each in store.standings():
        if each.known.retired:
            continue
        due, because = next_of(each, method, now, hours)
        errors = errors_by(each, now)
        out.append(NextCheck(each.known, each.watched, errors[-1] if errors else None, due, because))
    return sorted(out, key=lambda each: (each.due is not None, now if each.due is None else each.due.date))


def errors_by(standing: RobotState, now: datetime) -> Sequence[TrendPoint]:
    """The errors of a robot, oldest first, without those that a clock that was ahead dated later than now."""
    return [each for each in standing.errors if each.measured_at <= now] or standing.errors


def next_of(
    standing: RobotState, method: Method, now: datetime, hours: Hours | None = None
) -> tuple[Due | None, str]:
    """The next check of a robot, None where it has no date; and why then, or why not."""
    due = due_now(standing)
    try:
        due = due or next_due(
            method, checks_of(errors_by(standing, now), hours, standing.known.robot.serial), now
        )
    except DataError as error:
        return None, str(error)
    return due, due.because


def checks_of(points: Iterable[TrendPoint], hours: Hours | None = None, serial: str = "") -> list[Check]:
    """The values as checks; without a stated U only their scatter counts."""
    return [
        Check(
            point.measured_at,
            point.value,
            point.u or 0.0,
            None if hours is None else hours.at(serial, point.measured_at),
        )
        for point in points
    ]


def added_document(added: Sequence[tuple[Document, AddResult]]) -> dict[str, Any]:
    """The outcome of adding documents, as JSON has it."""
    told = [
        {
            "kind": document.kind,
            "serial": document.robot.serial,
            "model": document.robot.model,
            "identity": document.identity,
            "document": its.hash,
            "state": its.state,
            "contradicts": list(its.other_hashes),
        }
        for document, its in added
    ]
    return {"format": FORMAT, "added": told}


def trends_document(robot: RobotKey, trends: Sequence[Trend]) -> dict[str, Any]:
    """The trends of a robot, as JSON has them."""
    ours = {"left_out": True, "values": {"__all__": {"signal"}}}
    told = [each.shown().model_dump(exclude_unset=True, exclude=ours) for each in trends]
    return {"format": FORMAT, "serial": robot.serial, "model": robot.model, "trends": told}


def history_document(robot: RobotKey, lines: Sequence[HistoryLine]) -> dict[str, Any]:
    """The lines of a robot, as JSON has them."""
    told = [line.shown.model_dump(exclude_unset=True, exclude={"in_words", "here"}) for line in lines]
    return {"format": FORMAT, "serial": robot.serial, "model": robot.model, "history": told}


def retired(robot: RobotKey, cell: str, because: str, now: datetime) -> Document:
    """The statement that a robot is measured no more; because: why, a sentence."""
    table = {"format": "truepose-retired/1", "at": text_of(now), "because": because}
    identity = f"retired {robot.serial} {text_of(now)}"[:LONGEST].strip()
    return Document("retired", robot, cell, identity, now, json.dumps(table | asdict(robot)).encode())


def robots_document(robots: Sequence[RobotSummary]) -> dict[str, Any]:
    """The robots of a store, as JSON has them."""
    return {
        "format": FORMAT,
        "robots": [
            {
                "serial": each.robot.serial,
                "model": each.robot.model,
                "cells": list(each.cells),
                "documents": dict(each.documents),
                "last_measured": text_of(each.last),
                "retired": each.retired,
            }
            for each in robots
        ],
    }


def due_document(found: Sequence[NextCheck], now: datetime) -> dict[str, Any]:
    """The dates at which robots are due, as JSON has them."""
    return {
        "format": FORMAT,
        "now": text_of(now),
        "robots": [
            {
                "serial": each.known.robot.serial,
                "model": each.known.robot.model,
                "verdict": None if each.said is None else each.said.verdict,
                "error_mm": None if each.error is None else {"rms": each.error.value, "u": each.error.u},
                "due": None if each.due is None else text_of(each.due.date),
                "overdue": each.overdue(now),
                "because": each.because,
            }
            for each in found
        ],
    }


@dataclass(frozen=True)
class Hours:
    """Readings (time, hours) of every serial number, oldest first."""

    readings: Mapping[str, Sequence[tuple[datetime, float]]]

    def at(self, serial: str, moment: datetime) -> float | None:
        """Hours that a counter showed at a time; None where no readings are around it."""
        readings = self.readings.get(serial, ())
        for then, hours in readings:
            if then == moment:
                return hours
        for (a, before), (b, after) in pairwise(readings):
            if a < moment < b:
                return before + (after - before) * ((moment - a) / (b - a))
        return None


def read_hours(path: Path) -> Hours:
    """Read `serial,at,hours`; times as 2026-03-02 or 2026-03-02T09:15, UTC. Raises DataError naming the line."""
    rows = rows_of(read_text(path), path)
    if not rows or rows[0][1] != COLUMNS:
        raise DataError(
            f"has no columns {','.join(COLUMNS)}.", do="Name them in its first line.", file=path, line=1
        )
    found: dict[str, list[tuple[datetime, float]]] = defaultdict(list)
    for line, cells in rows[1:]:
        try:
            serial, at, hours = cells
            moment, count = datetime.fromisoformat(at), float(hours)
        except ValueError as error:
            raise DataError(
                f"is no reading of a counter ({error}).",
                do="Write e.g. 120-4711,2026-03-02,1840.",
                file=path,
                line=line,
            ) from error
        found[serial].append((moment if moment.tzinfo else moment.replace(tzinfo=UTC), count))
    return Hours({serial: sorted(readings) for serial, readings in found.items()})


def state_of(standing: RobotState) -> str:
    """The state of a robot by now: that of the last watch, unless it is retired or a model is newer."""
    watched, model = standing.watched, standing.baseline
    if standing.known.retired:
        return "retired"
    if watched is None:
        return "not_watched"
    if model is not None and model.measured_at > watched.measured_at:
        return "recalibrated"
    return watched.verdict if watched.verdict in ("unchanged", *CHANGED) else "not_watched"


def due_now(standing: RobotState) -> Due | None:
    """A robot that has changed is due since the watch that says so; None for any other state."""
    watched = standing.watched
    if watched is None or state_of(standing) not in CHANGED:
        return None
    return Due(
        watched.measured_at, f"Now: the last watch found it {watched.verdict}. {watched.advice}".strip()
    )


def doubtful_date(known: RobotSummary, now: datetime) -> datetime | None:
    """A date among the documents of a robot that only a wrong clock can have written; None where there is none."""
    if known.last > now + _AHEAD:
        return known.last
    return known.first if known.first < _EARLIEST else None
