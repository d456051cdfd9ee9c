"""The one reader of a record: what was measured at the poses of its plan, one frozen row a reading.

Data set, verification and drift are functions of these rows. Lengths mm, angles deg, times s on the record's clock.

Drift seen live: how far the reference pose is now from where it was first, and the most it has ever been.

In the world frame; with one SMR each target is compared with its own first reading. What was measured while warming
up, or put aside, does not count. Lengths mm.
"""

from __future__ import annotations

import json
import sqlite3
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from acquisition.cell.workspace import targets_at
from acquisition.record.store import RecordStore

Numbers = tuple[float, ...]
_AT_POSES = "pose.kind = 'pose'"
_BETWEEN = "pose.kind = 'nest' AND pose.base_target IS NOT NULL AND attempt.arrival IS NULL"

# A ball of the tool that a person has jogged into a cup: no joints were planned, those read are of its arrival.
_TOUCHES = "pose.kind = 'nest' AND pose.base_target IS NOT NULL AND attempt.arrival IS NOT NULL"

_ROWS = """
SELECT attempt.*, pose.set_name, pose.target, pose.base_target, pose.joints_deg, pose.sides, pose.approach_deg,
       pose.reason, pose.replaced_by, arrival.read_deg AS reached_deg
FROM attempt JOIN pose ON pose.id = attempt.pose LEFT JOIN attempt AS arrival ON arrival.id = attempt.arrival
WHERE {which} AND pose.set_name = coalesce(?, pose.set_name)
  AND (attempt.status = 'good' OR (pose.status = 'skipped' AND attempt.id = (
      SELECT max(id) FROM attempt AS last WHERE last.pose = pose.id)))
ORDER BY attempt.id
"""


@dataclass(frozen=True, slots=True)
class Reading:
    """One reading of a target at a pose, or the last attempt at one that was given up. What is not known is None.

    point: in the instrument's own frame, world: in the frame of the nests, turn: the quaternion in that frame, scalar
    first. joints, approach: as commanded, the joints of a robot that is driven by hand as a person said that it shows
    them; reached: the controller's read-back; sides: from which the joints came.
    arrival: number of the arrival on which it relies: those of one share where the robot came to rest. robot,
    instrument: their numbers in the record. counts: it was measured, and not measured again; else `reason`.
    """

    id: int
    pose: int
    visit: int
    arrival: int | None
    set_name: str
    target: str
    base_target: str | None
    joints: Numbers
    approach: Numbers
    sides: Numbers
    reached: Numbers | None
    point: Numbers | None
    world: Numbers | None
    turn: Numbers | None
    length_mm: float | None
    t_s: float
    t_air_c: float | None
    station: int
    robot: int | None
    instrument: int | None
    counts: bool
    reason: str


def readings_of(store: RecordStore, set_name: str | None = None) -> list[Reading]:
    """Every reading of a record, in the order of measuring; of one set where it is named. Raises StorageError."""
    return [
        _reading(row, by_hand=store.driven_by_hand)
        for row in store.database.query(_ROWS.format(which=_AT_POSES), (set_name,))
    ]


def spans_of(store: RecordStore) -> list[Reading]:
    """Every distance between two balls of one body, in the order of measuring; no joints. Raises StorageError."""
    return [_reading(row) for row in store.database.query(_ROWS.format(which=_BETWEEN), (None,))]


def touches_of(store: RecordStore) -> list[Reading]:
    """Every touch of a cup by a ball of the tool, in the order of measuring: `reached` is where.

    Raises StorageError.
    """
    return [_reading(row) for row in store.database.query(_ROWS.format(which=_TOUCHES), (None,))]


def _reading(row: sqlite3.Row, *, by_hand: bool = False) -> Reading:
    def all_of(*names: str) -> Numbers | None:
        values = tuple(row[name] for name in names)
        return None if None in values else values

    reached = row["reached_deg"]
    return Reading(
        id=row["id"],
        pose=row["pose"],
        visit=row["visit"],
        arrival=row["arrival"],
        set_name=row["set_name"],
        target=row["target"],
        base_target=row["base_target"],
        joints=tuple(json.loads(reached if by_hand and reached else row["joints_deg"])),
        approach=tuple(json.loads(row["approach_deg"])),
        sides=tuple(json.loads(row["sides"])),
        reached=tuple(json.loads(reached)) if reached else None,
        point=all_of(*(f"tracker_{axis}_mm" for axis in "xyz")),
        world=all_of(*(f"world_{axis}_mm" for axis in "xyz")),
        turn=all_of(*(f"world_rot_{axis}" for axis in "wxyz")),
        length_mm=row["length_mm"],
        t_s=row["began_t_s"] if row["ended_t_s"] is None else row["ended_t_s"],
        t_air_c=row["t_air_c"],
        station=row["station"],
        robot=row["robot"],
        instrument=row["instrument"],
        counts=row["status"] == "good" and row["replaced_by"] is None,
        reason=row["reason"],
    )


@dataclass(frozen=True)
class ReferenceDrift:
    """The drift in `readings` reference readings: `now_mm` (x, y, z) of the last, its length `off_mm`, the largest."""

    readings: int
    now_mm: tuple[float, float, float]
    off_mm: float
    most_mm: float
    t_s: float

    def as_dict(self) -> dict[str, Any]:
        """The values for JSON."""
        return asdict(self)


def drift_of(store: RecordStore) -> ReferenceDrift | None:
    """The drift so far; None before a second reading of the reference pose."""
    first: dict[str, np.ndarray] = {}
    drifts: list[tuple[float, np.ndarray]] = []
    rows = [row for row in readings_of(store, "reference") if row.counts]
    for row in rows:
        point = np.array(row.world)
        if (
            store.driven_by_hand
        ):  # never twice in the same place: what the nominal robot does from one to the other
            at = targets_at(store.cell, np.array([row.joints]))[0]
            point = point - at[list(store.cell.tool.targets).index(row.target)]
        if row.target in first:
            drifts.append((row.t_s, point - first[row.target]))
        else:
            first[row.target] = point
    if not drifts:
        return None
    lengths = [float(np.linalg.norm(moved)) for _, moved in drifts]
    t_s, (x, y, z) = drifts[-1]
    return ReferenceDrift(len(rows), (float(x), float(y), float(z)), lengths[-1], max(lengths), t_s)
