"""The readings of a record at the poses of its plan, one frozen row per reading.

All other code reads them here: data set, verification and drift are functions of these rows. Lengths mm, angles deg,
times s on the record's clock.

The drift is the distance of the reference pose from its first reading, now and at its largest, in the world frame. With
one SMR each target is compared with its own first reading. Readings of the warm-up, or that were put aside, do not
count. Lengths in mm.
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
    """One reading of a target at a pose, or the last attempt at an abandoned one.

    Unknown values are None.

    Attributes
    ----------
    arrival
        Number of the arrival on which it relies; readings with the same number share one approach of the robot.
    joints, approach
        Joints as commanded, and those of the approach point. The joints of a robot that is driven by hand are those
        that a person reported.
    sides
        Sides from which the joints came.
    reached
        The controller's read-back.
    point
        The point in the instrument's own frame, mm.
    world
        The point in the frame of the nests, mm.
    turn
        The orientation in the frame of the nests, a quaternion, scalar first.
    robot, instrument
        Numbers of the devices in the record.
    counts
        Whether it was measured, and not measured again; otherwise `reason` states why.
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
    """Return every reading of a record, or of one set, in the order of measuring.

    Raises
    ------
    StorageError
        The record cannot be read.
    """
    return [
        _reading(row, by_hand=store.driven_by_hand)
        for row in store.database.query(_ROWS.format(which=_AT_POSES), (set_name,))
    ]


def spans_of(store: RecordStore) -> list[Reading]:
    """Return every distance between two balls of one body, in the order of measuring.

    They have no joints.

    Raises
    ------
    StorageError
        The record cannot be read.
    """
    return [_reading(row) for row in store.database.query(_ROWS.format(which=_BETWEEN), (None,))]


def touches_of(store: RecordStore) -> list[Reading]:
    """Return every touch of a cup by a ball of the tool, in the order of measuring.

    The joints of the touch are in `reached`.

    Raises
    ------
    StorageError
        The record cannot be read.
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
    """The drift in `readings` reference readings.

    `now_mm` is the displacement (x, y, z) of the last, `off_mm` its length, and `most_mm` the largest length.
    """

    readings: int
    now_mm: tuple[float, float, float]
    off_mm: float
    most_mm: float
    t_s: float

    def as_dict(self) -> dict[str, Any]:
        """Return the values for JSON."""
        return asdict(self)


def drift_of(store: RecordStore) -> ReferenceDrift | None:
    """Compute the drift so far; None before a second reading of the reference pose."""
    first: dict[str, np.ndarray] = {}
    drifts: list[tuple[float, np.ndarray]] = []
    rows = [row for row in readings_of(store, "reference") if row.counts]
    for row in rows:
        point = np.array(row.world)
        if store.driven_by_hand:  # never twice in the same place: the motion of the nominal robot in between
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


def accuracy_of(store: RecordStore) -> dict[str, Any] | None:
    """Return what the last look of an adaptive block found, with the history of all looks; None without one."""
    looks = store.data_of_events("accuracy")
    if not looks:
        return None
    shown = ("poses", "rms_mm", "bound_mm")
    last = {key: value for key, value in looks[-1].items() if key not in ("misses", "waited_s")}
    return last | {"history": [{key: each[key] for key in shown} for each in looks]}
