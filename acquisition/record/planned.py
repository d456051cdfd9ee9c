"""Planned readings of a record, as its rows of `pose` hold them."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import groupby

from acquisition.campaign.plan import Visit


@dataclass(frozen=True)
class Planned:
    """A planned reading: a target in a visit, and what became of it."""

    id: int
    visit: Visit
    target: str
    status: str
    base_target: str | None = None  # of a distance


def planned_of(rows: Iterable[sqlite3.Row]) -> list[Planned]:
    """The planned readings of rows of `pose`; those of one visit follow one another and share it."""
    out: list[Planned] = []
    for _, group in groupby(rows, key=lambda row: row["visit"]):
        readings = list(group)
        row, targets = readings[0], tuple(each["target"] for each in readings)
        joints, sides, approach = (
            tuple(json.loads(row[key])) for key in ("joints_deg", "sides", "approach_deg")
        )
        place = (row["visit"], row["name"], row["kind"], row["set_name"], row["block"])
        bases = tuple(each["base_target"] for each in readings if each["base_target"] is not None)
        waypoints = tuple(map(tuple, json.loads(row["waypoints"] or "[]")))
        visit = Visit(*place, targets, joints, sides, approach, bases, waypoints)
        out += [
            Planned(each["id"], visit, each["target"], each["status"], each["base_target"])
            for each in readings
        ]
    return out
