"""The values of parameters over time, of one robot or of all."""

from __future__ import annotations

from collections import defaultdict
from itertools import groupby
from operator import itemgetter

import sqlalchemy as sa

from fleet.store import tables
from fleet.store.document import Point, RobotKey
from fleet.store.rediagnosed import rediagnosed


def points_of(
    connection: sa.Connection, robot: RobotKey | None, parameter: str | None, *, again: bool
) -> dict[RobotKey, list[Point]]:
    """The values of one parameter, or of all (None), by name and time, of a robot, or of all (None).

    again: whether what a re-diagnosis says of the same readings stands in the place of the cell's own model.
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
    found: dict[RobotKey, list[Point]] = defaultdict(list)
    for names, rows in groupby(connection.execute(question), key=itemgetter(0, 1)):
        key = RobotKey(*names)
        _, times = newer.get(key, ((), ()))
        found[key] += [
            Point(*point) for _, _, kind, *point in rows if kind != "model" or point[0] not in times
        ]
    for key, (points, _) in newer.items():
        found[key] = sorted((*found[key], *points), key=lambda each: (each.parameter, each.measured_at))
    return found
