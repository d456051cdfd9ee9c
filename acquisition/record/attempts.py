"""Attempts and prompts of a record: written before the act, closed by its outcome."""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

from acquisition.campaign.plan import Visit
from acquisition.cell.world_frame import WorldFrame
from acquisition.record.states import State
from acquisition.record.store import PlannedReading, RecordStore
from drivers.errors import AcquisitionError
from drivers.interfaces import JointReading, LengthReading, PointReading, PoseReading, Prompt, Reading

VOID = "void"  # the answer of a prompt for which no one waits any more


class Attempts:
    """The attempts of one record."""

    def __init__(self, store: RecordStore) -> None:
        self._store = store

    def begin_arrival(self, visit: Visit) -> int:
        """Record that the robot is about to go to the approach point and on to the pose."""
        return self._begin("arrive", visit.number, None, None)

    def begin_reading(self, planned: PlannedReading, arrival: int | None) -> int:
        """Record that the instrument is about to measure.

        `arrival` is the good arrival on which the reading relies; None for a nest.
        """
        return self._begin("measure", planned.visit.number, planned.id, arrival)

    def _begin(self, kind: str, visit: int, pose: int | None, arrival: int | None) -> int:
        now = self._store.moment()
        with self._store.changing() as db:
            return db.execute(
                "INSERT INTO attempt (kind, visit, pose, arrival, began_utc, began_t_s, station, robot, instrument) "
                "SELECT ?, ?, ?, ?, ?, ?, station, (SELECT max(id) FROM device WHERE role = 'robot'), "
                "(SELECT max(id) FROM device WHERE role = 'instrument') FROM campaign RETURNING id",
                (kind, visit, pose, arrival, now.utc, now.t_s),
            ).fetchone()[0]

    def arrived(self, attempt: int, reached: JointReading) -> None:
        """Record that the robot is in the pose."""
        with self._store.changing() as db:
            self._close(db, attempt, "good", raw=reached.raw, read_deg=json.dumps(list(reached.joints_deg)))
            self._store.note(db, "arrived", attempt=attempt, read_deg=list(reached.joints_deg))

    def measured(
        self,
        attempt: int,
        planned: PlannedReading,
        reading: Reading,
        world: WorldFrame | None,
        as_planned: Sequence[float] | None = None,
    ) -> None:
        """Record a good reading; it is durable, and the planned reading done, when this returns.

        `world` is the world frame if it is known. `as_planned` (3,), mm, world, is the point as it would be at the
        planned joints (`run.checks.repeated_point`).
        """
        data: dict[str, Any] = {
            "attempt": attempt,
            "pose": planned.id,
            "name": planned.visit.name,
            "set": planned.visit.set,
            "target": planned.target,
            "t_air_c": reading.t_air_c,
        }
        values: dict[str, Any] = {
            "raw": reading.raw,
            "samples": reading.samples,
            "device_t_s": reading.t_s,
            "t_air_c": reading.t_air_c,
        }
        if isinstance(reading, LengthReading):
            data |= {"base_target": planned.base_target, "length_mm": reading.length_mm}
            values |= _length(reading)
        else:
            values |= _point(reading, world)
            data |= {
                "tracker_mm": _triple(values, "tracker_{}_mm"),
                "world_mm": _triple(values, "world_{}_mm"),
                "as_planned_mm": None if as_planned is None else list(as_planned),
            }
        with self._store.changing() as db:
            self._close(db, attempt, "good", **values)
            self._store.set_status(db, planned.id, "measured")
            self._store.note(db, "reading", **data)

    def failed(self, attempt: int, error: AcquisitionError) -> None:
        """Record that the attempt failed, with the reason and the raw reply."""
        with self._store.changing() as db:
            self._close(db, attempt, "failed", raw=error.raw, error_code=error.code, error=error.message)
            self._store.note(db, "attempt_failed", attempt=attempt, error=error.as_dict())

    def _close(self, db: sqlite3.Connection, attempt: int, status: str, **values: Any) -> None:
        now = self._store.moment()
        values |= {"status": status, "ended_utc": now.utc, "ended_t_s": now.t_s}
        self._store.seals.close(db, attempt, **values)

    # -- prompts ------------------------------------------------------------------------------------------

    def ask(self, prompt: Prompt) -> None:
        """Record that a question is about to be put to a person."""
        with self._store.changing() as db:
            expects = [answer.value for answer in prompt.expects]
            db.execute(
                "INSERT INTO prompt (id, text, picture, expects, asked_utc) VALUES (?, ?, ?, ?, ?)",
                (prompt.id, prompt.text, prompt.picture, json.dumps(expects), self._store.moment().utc),
            )
            entry = {} if prompt.entry is None else {"entry": asdict(prompt.entry)}
            self._store.note(db, "prompt", id=prompt.id, text=prompt.text, expects=expects, **entry)
            self._store.change_state(db, State.WAITING, prompt.text)

    def answered(self, prompt_id: str, answer: str, by: str, reason: str = "", typed: str = "") -> None:
        """Record the answer to a prompt, with which the campaign continues; or VOID.

        A typed value is kept as it was typed.
        """
        with self._store.changing() as db:
            db.execute(
                "UPDATE prompt SET answer = ?, answered_by = ?, reason = ?, answered_utc = ? "
                "WHERE id = ? AND answer IS NULL",
                (answer, by, reason, self._store.moment().utc, prompt_id),
            )
            beside = {"typed": typed} if typed else {}
            self._store.note(db, "answer", id=prompt_id, answer=answer, by=by, reason=reason, **beside)
            if answer != VOID:
                self._store.change_state(db, State.RUNNING, "")

    def open_prompt(self) -> dict[str, Any] | None:
        """Return the prompt that waits for its answer: id, text, picture, expects, entry."""
        rows = self._store.database.query("SELECT * FROM prompt WHERE answer IS NULL ORDER BY rowid DESC")
        if not rows:
            return None
        row = rows[0]
        asked = self._store.database.query(
            "SELECT data FROM event WHERE kind = 'prompt' ORDER BY id DESC LIMIT 1"
        )
        return {
            "id": row["id"],
            "text": row["text"],
            "picture": row["picture"],
            "expects": json.loads(row["expects"]),
            "entry": json.loads(asked[0]["data"]).get("entry") if asked else None,
        }


def _point(reading: PointReading, world: WorldFrame | None) -> dict[str, Any]:
    """Return the columns of a point and, for a pose, of its orientation.

    They include the world coordinates once the world frame is known.
    """
    values: dict[str, Any] = {
        "pressure_hpa": reading.pressure_hpa,
        "humidity_percent": reading.humidity_percent,
    }
    for axis, place, scatter in zip("xyz", reading.xyz_mm, reading.std_mm, strict=True):
        values |= {f"tracker_{axis}_mm": place, f"std_{axis}_mm": scatter}
    if world is not None:
        values |= _named("world_{}_mm", "xyz", world.to_world(reading.xyz_mm).tolist())
    if isinstance(reading, PoseReading):
        values |= _named("rot_{}", "wxyz", reading.rot_wxyz)
        values |= {
            "rot_std_mrad": reading.rot_std_mrad,
            "visible_tool": reading.visible_tool,
            "visible_base": reading.visible_base,
        }
        if world is not None:
            values |= _named("world_rot_{}", "wxyz", world.turned_to_world(reading.rot_wxyz).tolist())
    return values


def _length(reading: LengthReading) -> dict[str, Any]:
    return {
        "length_mm": reading.length_mm,
        "std_length_mm": reading.std_mm,
        "deviation_mm": reading.deviation_mm,
        "zero_mm": reading.zero_mm,
        "battery_percent": reading.battery_percent,
    }


def _named(name: str, axes: str, numbers: Sequence[float]) -> dict[str, float]:
    return {name.format(axis): number for axis, number in zip(axes, numbers, strict=True)}


def _triple(values: Mapping[str, Any], name: str) -> list[float] | None:
    point = [values[key] for key in map(name.format, "xyz") if key in values]
    return point or None
