"""History of a robot: documents, trends of parameters, state and next check.

The hours of use come from a table of counter readings that a person or a PLC keeps. The robot is assumed to be used
evenly between two readings of the counter. Before the first and after the last reading its use is unknown.

The state of a robot is that of its last watch. A changed robot is due now. Dates that only a wrong clock can have
written are reported.
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
    """Find the robot of a serial number.

    Parameters
    ----------
    model : str or None
        Type of the robot, if robots of several types have that serial number.

    Raises
    ------
    DataError
        The store has no such robot, or robots of several types.
    """
    found = [each for each in store.named() if each.serial == serial]
    if model is not None:
        found = [each for each in found if each.model == model]
    if not found:
        raise DataError(
            f"has nothing of a robot '{serial}'.",
            do="truepose history robots lists the robots of the store.",
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
    """Document of a robot, with its verdict and error if it states them."""

    entry: DocumentSummary
    said: VerdictRecord | None
    error: TrendPoint | None

    @property
    def in_words(self) -> str:
        """Verdict, causes and error in one line."""
        words = []
        if self.said is not None:
            words.append(self.said.verdict)
            words += [cause.label for cause in self.said.causes]
        if self.error is not None:
            words.append(f"error {self.error.value:.3f} mm")
        return ", ".join(words)

    @property
    def shown(self) -> LineShown:
        """Line of the history, as answered."""
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
    """List the documents of a robot, oldest first."""
    said = {each.hash: each for each in store.verdicts(robot)}
    errors = {each.hash: each for each in store.trend(robot, ERROR, rediagnosed=False)}
    entries = reversed(store.documents(robot, limit=MOST))
    return [HistoryLine(each, said.get(each.hash), errors.get(each.hash)) for each in entries]


@dataclass(frozen=True)
class Trend:
    """Values of one parameter, oldest first, with their control chart.

    `because` is the reason if there is no chart, otherwise empty.
    """

    robot: RobotKey
    parameter: str
    unit: str
    points: tuple[TrendPoint, ...]
    chart: ControlChart | None
    because: str

    @classmethod
    def of(cls, robot: RobotKey, points: Sequence[TrendPoint]) -> Trend:
        """Create the trend of one parameter from its values.

        Raises
        ------
        DataError
            The values have different units.
        """
        units = sorted({point.unit for point in points})
        if len(units) > 1:
            raise DataError(
                f"has values in {' and in '.join(units)}.",
                do="Find out which program wrote them: truepose history show.",
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
    """Return the trends of one parameter of a robot, or of all parameters by name.

    Raises
    ------
    DataError
        The robot does not have the parameter, or no parameter at all.
    """
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
    """Return the trends of values that are sorted by name and time.

    The errors are those of `Trend.of`.
    """
    by_name = groupby(points, key=lambda point: point.parameter)
    return [Trend.of(robot, list(each)) for _, each in by_name]


@dataclass(frozen=True)
class NextCheck:
    """Robot with its next check.

    Attributes
    ----------
    said
        Verdict of the last watch.
    error
        Last value of its error.
    because
        Reason for the date, or for its absence.
    """

    known: RobotSummary
    said: VerdictRecord | None
    error: TrendPoint | None
    due: Due | None
    because: str

    def overdue(self, now: datetime) -> bool:
        """Return whether the date of the next check is not later than `now`."""
        return self.due is not None and self.due.date <= now


def due_of(store: FleetStore, method: Method, now: datetime, hours: Hours | None = None) -> list[NextCheck]:
    """List the next check of each robot, earliest first; a changed robot is due now.

    Robots without a date come first, and retired robots are omitted. `hours` are the hours of use, for a method that
    depends on them.
    """
    out = []
    for each in store.standings():
        if each.known.retired:
            continue
        due, because = next_of(each, method, now, hours)
        errors = errors_by(each, now)
        out.append(NextCheck(each.known, each.watched, errors[-1] if errors else None, due, because))
    return sorted(out, key=lambda each: (each.due is not None, now if each.due is None else each.due.date))


def errors_by(standing: RobotState, now: datetime) -> Sequence[TrendPoint]:
    """Return the errors of a robot, oldest first, without those dated in the future.

    A clock that is ahead causes such dates. If all of the errors have one, all are returned.
    """
    return [each for each in standing.errors if each.measured_at <= now] or standing.errors


def next_of(
    standing: RobotState, method: Method, now: datetime, hours: Hours | None = None
) -> tuple[Due | None, str]:
    """Return the next check of a robot, or None if it has no date, and the reason."""
    due = due_now(standing)
    try:
        due = due or next_due(
            method, checks_of(errors_by(standing, now), hours, standing.known.robot.serial), now
        )
    except DataError as error:
        return None, str(error)
    return due, due.because


def checks_of(points: Iterable[TrendPoint], hours: Hours | None = None, serial: str = "") -> list[Check]:
    """Convert values to checks; without a stated U only their scatter counts."""
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
    """Return the result of adding documents as a JSON document."""
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
    """Create the document that retires a robot. `because` is the reason, a sentence."""
    table = {"format": "truepose-retired/1", "at": text_of(now), "because": because}
    identity = f"retired {robot.serial} {text_of(now)}"[:LONGEST].strip()
    return Document("retired", robot, cell, identity, now, json.dumps(table | asdict(robot)).encode())


def robots_document(robots: Sequence[RobotSummary]) -> dict[str, Any]:
    """Return the robots of a store as a JSON document."""
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
    """Return the dates of the next checks as a JSON document."""
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
    """Counter readings (time, hours) of each serial number, oldest first."""

    readings: Mapping[str, Sequence[tuple[datetime, float]]]

    def at(self, serial: str, moment: datetime) -> float | None:
        """Interpolate the hours of use at a time; None if it is not between two readings."""
        readings = self.readings.get(serial, ())
        for then, hours in readings:
            if then == moment:
                return hours
        for (a, before), (b, after) in pairwise(readings):
            if a < moment < b:
                return before + (after - before) * ((moment - a) / (b - a))
        return None


def read_hours(path: Path) -> Hours:
    """Read a table `serial,at,hours`; times as 2026-03-02 or 2026-03-02T09:15, UTC.

    Raises
    ------
    DataError
        The columns or a row are not valid; the error names the line.
    """
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
                f"is not a reading of a counter ({error}).",
                do="Write e.g. 120-4711,2026-03-02,1840.",
                file=path,
                line=line,
            ) from error
        found[serial].append((moment if moment.tzinfo else moment.replace(tzinfo=UTC), count))
    return Hours({serial: sorted(readings) for serial, readings in found.items()})


def state_of(standing: RobotState) -> str:
    """Return the current state of a robot.

    It is that of the last watch, unless the robot is retired or its model is newer.
    """
    watched, model = standing.watched, standing.baseline
    if standing.known.retired:
        return "retired"
    if watched is None:
        return "not_watched"
    if model is not None and model.measured_at > watched.measured_at:
        return "recalibrated"
    return watched.verdict if watched.verdict in ("unchanged", *CHANGED) else "not_watched"


def due_now(standing: RobotState) -> Due | None:
    """Return the due date of a changed robot, that of the last watch; None for any other state."""
    watched = standing.watched
    if watched is None or state_of(standing) not in CHANGED:
        return None
    return Due(
        watched.measured_at, f"Now: the last watch found it {watched.verdict}. {watched.advice}".strip()
    )


def doubtful_date(known: RobotSummary, now: datetime) -> datetime | None:
    """Return a date of a robot that only a wrong clock can have written, or None."""
    if known.last > now + _AHEAD:
        return known.last
    return known.first if known.first < _EARLIEST else None
