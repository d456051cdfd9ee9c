"""The parameters of a robot from a re-diagnosis of its data sets, as points of a trend.

A re-diagnosis replaces the statement of the cell's own model on the same readings by that of another version
(`Store.trend`), and no measurement is shown twice. Of several versions the result that was finished last counts.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from datetime import datetime
from typing import Any

import sqlalchemy as sa

from fleet.store import tables
from fleet.store.document import RobotKey, TrendPoint
from fleet.store.rows import ERROR, K

FORMAT = "truepose-fleet-diagnosis/1"
TASK = "diagnose"
"""Whose results count: a search that was told to stop earlier has another name, and makes no model to compare."""
_MANY = 500  # keys in one question


def rediagnosed(
    connection: sa.Connection, robot: RobotKey | None, parameter: str | None
) -> dict[RobotKey, tuple[list[TrendPoint], set[datetime]]]:
    """Return the points of a trend, and the times of the data sets with such a model.

    The points are those of one parameter, or of all (None) with the error on held-out readings, for one robot, or for
    all (None). Excluded are data sets that do not state their time of measurement: their time is that of a file.
    Excluded are also those without held-out readings: they come from watches, and are too few for a model to compare.
    """
    found: dict[RobotKey, tuple[list[TrendPoint], set[datetime]]] = {}
    for row, table in _contents(connection, _last(connection, robot)):
        if table.get("parameters") and table.get("error_after_mm"):
            points, times = found.setdefault(RobotKey(row.serial, row.model), ([], set()))
            points += _points(row, table, parameter)
            times.add(row.measured_at)
    return found


def _last(connection: sa.Connection, robot: RobotKey | None) -> dict[str, Any]:
    """Return the last finished result of each data set, by its key.

    It has key, hash, robot and time of the data set, and program.
    """
    d, r, found = tables.document.c, tables.robot.c, tables.result.c
    question = (
        sa.select(found.key, d.hash, r.serial, r.model, d.measured_at, found.program)
        .join_from(tables.document, tables.robot)
        .join(tables.result, found.data == d.hash)
        .where(d.kind == "dataset", found.task == TASK, d.identity != "dataset " + d.hash)
        .order_by(found.finished_at, found.key)
    )
    if robot is not None:
        question = question.where(r.serial == robot.serial, r.model == robot.model)
    newest = {row.hash: row for row in connection.execute(question)}
    return {row.key: row for row in newest.values()}


def _contents(connection: sa.Connection, rows: Mapping[str, Any]) -> list[tuple[Any, dict[str, Any]]]:
    found, keys, out = tables.result.c, list(rows), []
    for begin in range(0, len(keys), _MANY):
        some = sa.select(found.key, found.bytes).where(found.key.in_(keys[begin : begin + _MANY]))
        out += [(rows[key], json.loads(bytes(content))) for key, content in connection.execute(some)]
    return out


def _points(row: Any, table: Mapping[str, Any], parameter: str | None) -> list[TrendPoint]:
    """Return the points of one result."""
    points = [
        TrendPoint(
            row.measured_at,
            each["name"],
            each["value"],
            None if each["std"] is None else K * each["std"],
            each["unit"],
            row.hash,
            row.program,
            rediagnosed=True,
        )
        for each in table["parameters"]
        if parameter in (None, each["name"]) and each["value"] is not None
    ]
    missed = table["error_after_mm"]
    if parameter in (None, ERROR) and missed["rms"] is not None:
        u = K * missed["rms"] / math.sqrt(6.0 * missed["n"])
        points.append(
            TrendPoint(
                row.measured_at, ERROR, missed["rms"], u, "mm", row.hash, row.program, rediagnosed=True
            )
        )
    return points
