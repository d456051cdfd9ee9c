"""Robot states: last verdicts, calibration, errors and parameters over time.

The verdicts are those of a watch and of a diagnosis. All robots need as many queries as one.

A document cannot have been measured after it came. If the clock of a cell is ahead, the day on which its document came
counts instead; otherwise its verdict would be the last one for years.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from itertools import groupby
from operator import itemgetter
from typing import Any

import sqlalchemy as sa

from fleet.store import tables
from fleet.store.document import Kind, NamedCause, RobotKey, RobotSummary, TrendPoint, VerdictRecord
from fleet.store.rediagnosed import rediagnosed
from fleet.store.rows import ERROR

_MANY = 500  # numbers in one question


@dataclass(frozen=True)
class BaselineRecord:
    """The newest calibration of a robot, the baseline of its next watch."""

    hash: str
    measured_at: datetime


@dataclass(frozen=True)
class RobotState:
    """A robot's state according to the store.

    `watched` and `diagnosed` are the last verdicts of each kind; `errors` are position errors, RMS in mm, oldest first.
    """

    known: RobotSummary
    watched: VerdictRecord | None
    diagnosed: VerdictRecord | None
    baseline: BaselineRecord | None
    errors: tuple[TrendPoint, ...]


def standings(
    connection: sa.Connection, known: Sequence[RobotSummary], robot: RobotKey | None
) -> list[RobotState]:
    """Return the state of every robot of `known`.

    `robot` is the one that is requested, None for all.
    """
    said = {(each.robot, each.kind): each for each in _said(connection, robot)}
    models = dict(_baselines(connection, robot))
    errors = points_of(connection, robot, ERROR, again=True)
    return [
        RobotState(
            each,
            said.get((each.robot, "watch")),
            said.get((each.robot, "diagnosis")),
            models.get(each.robot),
            tuple(errors.get(each.robot, ())),
        )
        for each in known
    ]


def _said(connection: sa.Connection, robot: RobotKey | None) -> list[VerdictRecord]:
    """Return the last verdict of each kind on each robot."""
    v, c, r = tables.verdict.c, tables.cause.c, tables.robot.c
    last = _newest(("watch", "diagnosis"), robot)
    question = (
        sa.select(last.c.id, r.serial, r.model, last.c.at, last.c.kind, last.c.hash)
        .add_columns(v.verdict, v.in_words, v.advice)
        .join_from(last, tables.verdict, v.document == last.c.id)
        .join(tables.robot, r.id == last.c.robot)
        .where(last.c.place == 1)
    )
    found = connection.execute(question).all()
    causes: dict[int, list[NamedCause]] = {row.id: [] for row in found}
    for begin in range(0, len(found), _MANY):
        some = [row.id for row in found[begin : begin + _MANY]]
        named = sa.select(c.document, c.label, c.in_words, c.weight, c.value, c.u, c.unit)
        for number, *rest in connection.execute(named.where(c.document.in_(some)).order_by(c.rank)):
            causes[number].append(NamedCause(*rest))
    return [
        VerdictRecord(RobotKey(serial, model), at, kind, hash, verdict, words, advice, tuple(causes[number]))
        for number, serial, model, at, kind, hash, verdict, words, advice in found
    ]


def _baselines(connection: sa.Connection, robot: RobotKey | None) -> list[tuple[RobotKey, BaselineRecord]]:
    """Return the newest calibration of each robot, or its newest model if it has none.

    A model that a watch has updated does not count; it has the time of the watch's readings. Judged by it, a changed
    robot would look unchanged before it is repaired.
    """
    d, w, r = tables.document.c, tables.document.alias(), tables.robot.c
    updated = sa.exists().where(
        w.c.robot == d.robot, w.c.measured_at == d.measured_at, w.c.kind.in_(("watch", "thermal"))
    )
    last = _newest(("model",), robot, sa.case((updated, 1), else_=0))
    question = (
        sa.select(r.serial, r.model, last.c.hash, last.c.at)
        .join_from(last, tables.robot, r.id == last.c.robot)
        .where(last.c.place == 1)
    )
    return [
        (RobotKey(serial, model), BaselineRecord(*rest))
        for serial, model, *rest in connection.execute(question)
    ]


def _newest(kinds: Sequence[Kind], robot: RobotKey | None, *first: sa.ColumnElement[Any]) -> sa.Subquery:
    """Rank the documents of these kinds among those of their robot and kind, the newest 1.

    `first` has criteria that count before the time.
    """
    d, r = tables.document.c, tables.robot.c
    at = sa.case((d.measured_at > d.added_at, d.added_at), else_=d.measured_at)
    place = sa.func.row_number().over(
        partition_by=(d.robot, d.kind), order_by=(*first, at.desc(), d.measured_at.desc(), d.id.desc())
    )
    question = sa.select(d.id, d.robot, d.kind, d.hash, at.label("at"), place.label("place"))
    question = question.where(d.kind.in_(kinds))
    if robot is not None:
        its = sa.select(r.id).where(r.serial == robot.serial, r.model == robot.model)
        question = question.where(d.robot == its.scalar_subquery())
    return question.subquery()


def points_of(
    connection: sa.Connection, robot: RobotKey | None, parameter: str | None, *, again: bool
) -> dict[RobotKey, list[TrendPoint]]:
    """Return the values of one parameter, or of all (None), by name and time.

    They are those of one robot, or of all (None). With `again`, a re-diagnosis of the same readings replaces the values
    of the cell's own model.
    """
    p, d, r = tables.parameter.c, tables.document.c, tables.robot.c
    question = (
        sa.select(r.serial, r.model, d.kind, p.measured_at, p.name, p.value, p.u, p.unit, d.hash, d.program)
        .join_from(tables.robot, tables.parameter)
        .join(tables.document, d.id == p.document)
        .order_by(p.robot, p.name, p.measured_at, p.document)
    )
    if robot is not None:
        question = question.where(r.serial == robot.serial, r.model == robot.model)
    if parameter is not None:
        question = question.where(p.name == parameter)
    newer = rediagnosed(connection, robot, parameter) if again else {}
    found: dict[RobotKey, list[TrendPoint]] = defaultdict(list)
    for names, rows in groupby(connection.execute(question), key=itemgetter(0, 1)):
        key = RobotKey(*names)
        _, times = newer.get(key, ((), ()))
        found[key] += [
            TrendPoint(*point) for _, _, kind, *point in rows if kind != "model" or point[0] not in times
        ]
    for key, (points, _) in newer.items():
        found[key] = sorted((*found[key], *points), key=lambda each: (each.parameter, each.measured_at))
    return found
