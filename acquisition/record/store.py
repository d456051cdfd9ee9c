"""The record of a campaign: its state, its plan, its attempts and their results.

Intent before act: an attempt is written before the robot moves or the instrument measures, and closed by its outcome.
Each change is one transaction with its events; listeners get an event only after it is durable. No reading that was
acknowledged is ever lost; at most the one in progress is repeated, and this is recorded.

A planned reading is a row of `pose`. An event states what happened, and when.
"""

from __future__ import annotations

import json
import sqlite3
import threading
import time
import uuid
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import groupby
from pathlib import Path
from typing import Any, Literal

from acquisition.campaign.plan import Visit
from acquisition.cell.cell import Cell, cell_of_record
from acquisition.cell.world_frame import WorldFrame
from acquisition.errors import RecordTaken, damaged
from acquisition.record import seal
from acquisition.record.database import Database, streams_kept
from acquisition.record.states import LEFT_BEHIND, State, check_transition

Point = tuple[float, ...]
COUNTED = "(kind = 'pose' OR base_target IS NOT NULL)"  # of planned readings: as `Visit.counted`
_OF_NESTS = "(kind = 'nest' AND base_target IS NULL)"
_STATES = frozenset(state.value for state in State)


class RecordStore:
    """The only writer of a record. Thread-safe.

    Every change makes sure that this program is still the record's owner. The lock can fail on a network disk, or if
    its file was deleted. Then the program that came first is refused from then on instead of mixing its readings in.

    Attributes
    ----------
    moment
        Returns the time for new entries.
    changes
        Number of changes made.
    """

    def __init__(self, database: Database) -> None:
        self.database = database
        self.seals = seal.Seals()
        self._owner = uuid.uuid4().hex
        self.moment: Callable[[], EventTime] = lambda: EventTime(time.time())
        self._listeners: list[Callable[[Event], None]] = []
        self._fresh: list[Event] = []
        self._depth = 0  # of changes within each other
        self.changes = 0
        self._changed = threading.Condition()

    @classmethod
    def create(
        cls, folder: Path, name: str, cell: str, campaign: str, visits: Sequence[Visit], *, simulated: bool
    ) -> RecordStore:
        """Create a new record, in state `ready`.

        Raises
        ------
        RecordError
            There is a record already.
        RecordInUse
            Another program runs it.
        StorageError
            The file cannot be written.
        """
        store = cls(Database(folder, writer=True, new=True))
        try:
            with store.changing() as db:
                db.execute(
                    "INSERT INTO campaign (id, name, created_utc, simulated, cell, campaign, state, owner) "
                    "VALUES (?, ?, ?, ?, ?, ?, 'draft', ?)",
                    (
                        uuid.uuid4().hex,
                        name,
                        store.moment().utc,
                        int(simulated),
                        cell,
                        campaign,
                        store._owner,
                    ),
                )
                store.seals.campaign(db)
                store._plan(db, visits)
                store.note(db, "created", name=name, visits=len(visits), sqlite=sqlite3.sqlite_version)
                store.change_state(db, State.READY, "")
        except BaseException:  # otherwise its lock would stay
            store.close()
            raise
        return store

    @classmethod
    def open(cls, folder: Path, *, writer: bool = True) -> RecordStore:
        """Open an existing record.

        If it will be written, every row is first compared with its checksum. This first pass does not open it for
        writing, because a writing connection applies a journal to the file when it is closed, even the journal of
        another record.

        Raises
        ------
        RecordError
            There is no record, or it has another version.
        RecordInUse
            Another program runs it.
        StorageError
            The file cannot be read or written.
        DamagedRecord
            The file or a row is damaged.
        """
        if writer:
            with cls.reading(folder):
                pass
        store = cls(Database(folder, writer=writer))
        if writer:
            try:
                with store.database.transaction() as db:
                    db.execute("UPDATE campaign SET owner = ?", (store._owner,))
            except BaseException:
                store.close()
                raise
        return store

    @classmethod
    @contextmanager
    def reading(cls, folder: Path) -> Iterator[RecordStore]:
        """Open an existing record to use its readings: every row agrees with its checksum.

        Errors are those of `open`.
        """
        store = cls.open(folder, writer=False)
        try:
            seal.check(store.database)
            yield store
        finally:
            store.close()

    def close(self) -> None:
        self.database.close()

    # -- changes and events -------------------------------------------------------------------------------

    @contextmanager
    def changing(self) -> Iterator[sqlite3.Connection]:
        """Enclose a durable change; changes may be nested.

        The events noted in it reach the listeners once it is durable.
        """
        with self.database.transaction() as db:
            if not self._depth:
                self._fresh = []
                self._check_owner(db)
            self._depth += 1  # guarded, as `_fresh` is, by the transaction
            try:
                yield db
            finally:
                self._depth -= 1
            if self._depth:
                return
            fresh, self._fresh = self._fresh, []
        with self._changed:
            self.changes += 1  # once they can be read
            self._changed.notify_all()
        for event in fresh:
            for listener in tuple(self._listeners):
                listener(event)

    def _check_owner(self, db: sqlite3.Connection) -> None:
        owner = db.execute("SELECT owner FROM campaign").fetchone()
        if owner is not None and owner[0] != self._owner:
            raise RecordTaken(f"{self.database.path}: another program writes this record now")

    def note(self, db: sqlite3.Connection, kind: str, **data: Any) -> None:
        """Write an event within a change."""
        now = self.moment()
        row = db.execute(
            "INSERT INTO event (utc, t_s, kind, data) VALUES (?, ?, ?, ?) RETURNING id",
            (now.utc, now.t_s, kind, json.dumps(data)),
        ).fetchone()
        self._fresh.append(Event(row[0], now.utc, now.t_s, kind, data))

    def add_event(self, kind: str, **data: Any) -> None:
        """Write an event in a separate change."""
        with self.changing() as db:
            self.note(db, kind, **data)

    @contextmanager
    def listening(self, listener: Callable[[Event], None]) -> Iterator[None]:
        """Call `listener` with every event, in the thread that caused it."""
        self._listeners.append(listener)
        try:
            yield
        finally:
            self._listeners.remove(listener)

    def events(self, after: int = 0, limit: int = 1000) -> list[Event]:
        """Return the events with a greater id than `after`, oldest first."""
        rows = self.database.query("SELECT * FROM event WHERE id > ? ORDER BY id LIMIT ?", (after, limit))
        return [Event(r["id"], r["utc"], r["t_s"], r["kind"], self._data_of(r["data"])) for r in rows]

    def data_of_events(self, kind: str) -> list[dict[str, Any]]:
        """Return the data of all events of a kind, oldest first."""
        rows = self.database.query("SELECT data FROM event WHERE kind = ? ORDER BY id", (kind,))
        return [self._data_of(row["data"]) for row in rows]

    def _data_of(self, text: str) -> dict[str, Any]:
        """Return the data of an event, which has no separate checksum."""
        try:
            return json.loads(text)
        except ValueError as error:
            raise damaged(self.database.path, f"holds an event that is damaged ({error})") from error

    @property
    def version(self) -> int:
        """Id of the last event."""
        return self.database.query("SELECT coalesce(max(id), 0) FROM event")[0][0]

    def wait_beyond(self, version: int, seconds: float) -> int:
        """Wait up to `seconds` of real time for a version beyond `version`, and return the version."""
        with self._changed:
            self._changed.wait_for(lambda: self.version > version, seconds)
        return self.version

    def last_reading(self) -> dict[str, Any] | None:
        """Return the data of the last `reading` event."""
        return self._last_of("reading")

    def last_waypoint(self) -> dict[str, Any] | None:
        """Return the data of the last `waypoint` event.

        These are attempt, waypoint, of, samples and lost by role.
        """
        return self._last_of("waypoint")

    def _last_of(self, kind: Literal["reading", "waypoint"]) -> dict[str, Any] | None:
        # The kind is in the query: only then SQLite uses the index of its events.
        rows = self.database.query(f"SELECT data FROM event WHERE kind = '{kind}' ORDER BY id DESC LIMIT 1")
        return self._data_of(rows[0][0]) if rows else None

    # -- state --------------------------------------------------------------------------------------------

    @property
    def campaign(self) -> sqlite3.Row:
        """The row of the campaign.

        Raises
        ------
        DamagedRecord
            The row does not agree with its checksum, or its state does not exist.
        """
        row = self.database.query("SELECT * FROM campaign")[0]
        if not seal.campaign_agrees(dict(row)):
            raise damaged(self.database.path, "holds a cell or a campaign that is not what it was begun with")
        if row["state"] not in _STATES:
            raise damaged(self.database.path, f"holds the state {row['state']!r}, which does not exist")
        return row

    @property
    def state(self) -> State:
        return State(self.campaign["state"])

    def change_state(self, db: sqlite3.Connection, new: State, reason: str) -> None:
        """Change the state, within a change of the record.

        Raises
        ------
        IllegalTransition
            The table of states does not allow it.
        """
        old = State(db.execute("SELECT state FROM campaign").fetchone()[0])
        check_transition(old, new)
        db.execute("UPDATE campaign SET state = ?, reason = ?", (new.value, reason))
        self.note(db, "state", state=new.value, code=new.code, reason=reason)

    def become(self, new: State, reason: str = "") -> None:
        """Change the state.

        Raises
        ------
        IllegalTransition
            The table of states does not allow it.
        StorageError
            The record cannot be written.
        """
        with self.changing() as db:
            self.change_state(db, new, reason)

    def start(self) -> None:
        """Change the state to `running`; the first time, start the campaign's clock."""
        with self.changing() as db:
            db.execute("UPDATE campaign SET started_utc = coalesce(started_utc, ?)", (self.moment().utc,))
            self.change_state(db, State.RUNNING, "")

    def recover(self) -> None:
        """Recover after a crash.

        Open attempts are marked as died, open prompts become void, and an active campaign is paused.
        """
        with self.changing() as db:
            self.close_attempts(db)
            db.execute("UPDATE prompt SET answer = 'void' WHERE answer IS NULL")
            if State(db.execute("SELECT state FROM campaign").fetchone()[0]).active:
                self.change_state(db, State.PAUSED, LEFT_BEHIND)

    def close_attempts(self, db: sqlite3.Connection) -> None:
        """Mark the open attempts as died: nothing carries them on."""
        for row in db.execute("SELECT id, kind, visit, pose FROM attempt WHERE status = 'open'").fetchall():
            self.seals.close(db, row["id"], status="died")
            died = {"attempt": row["id"], "act": row["kind"], "pose": row["pose"]}
            self.note(db, "attempt_died", **died, **streams_kept(db, row["id"]))

    def command(self, verb: str, by: str, key: str | None = None) -> bool:
        """Record a command of a person or client; False if its idempotency key was used before."""
        with self.changing() as db:
            if key is not None and db.execute("SELECT 1 FROM command WHERE key = ?", (key,)).fetchone():
                return False
            db.execute(
                "INSERT INTO command (utc, verb, by, key) VALUES (?, ?, ?, ?)",
                (self.moment().utc, verb, by, key),
            )
            self.note(db, "command", verb=verb, by=by)
        return True

    # -- plan ---------------------------------------------------------------------------------------------

    def plan(self) -> list[PlannedReading]:
        """Return every planned reading that counts, in the order of the plan."""
        return self._planned("TRUE ORDER BY visit, id", ())

    def left(self, status: str, *, nests: bool = False) -> list[PlannedReading]:
        """Return the readings with this status in the first visit that has one.

        The visit is one of nests, or one of all others. The list is empty if there is none.
        """
        kind = _OF_NESTS if nests else COUNTED
        same_visit = (
            f"{kind} AND visit = (SELECT visit FROM pose WHERE {kind} AND status = ? AND replaced_by IS NULL "
            "ORDER BY visit LIMIT 1) ORDER BY id"
        )
        return [each for each in self._planned(same_visit, (status,)) if each.status == status]

    def _planned(self, where: str, values: Sequence[Any]) -> list[PlannedReading]:
        rows = self.database.query(f"SELECT * FROM pose WHERE replaced_by IS NULL AND {where}", values)
        return planned_of(rows)

    def counts(self) -> dict[str, int]:
        """Count the planned readings by status, without those of nests."""
        rows = self.database.query(
            f"SELECT status, count(*) FROM pose WHERE {COUNTED} AND replaced_by IS NULL GROUP BY status"
        )
        return {row[0]: row[1] for row in rows}

    def mark(self, pose: int, status: str, reason: str) -> None:
        """Record that a planned reading is postponed (`deferred`) or abandoned (`skipped`)."""
        with self.changing() as db:
            self.set_status(db, pose, status, reason)
            self.note(db, status, pose=pose, reason=reason)

    def set_status(self, db: sqlite3.Connection, pose: int, status: str, reason: str = "") -> None:
        """Write the status of a reading; only within a change."""
        db.execute("UPDATE pose SET status = ?, reason = ? WHERE id = ?", (status, reason, pose))
        self.seals.row(db, "pose", pose)

    def measure_again(self, poses: Sequence[int], reason: str) -> None:
        """Plan new readings in place of readings that are not trusted.

        The old ones stay in the record, but are not used.
        """
        if not poses:
            return
        with self.changing() as db:
            again = [self._replace(db, pose, reason) for pose in poses]
            self.note(db, "measure_again", poses=list(poses), replaced_by=again, reason=reason)

    def add_visits(self, visits: Sequence[Visit]) -> None:
        """Add visits to the end of the plan."""
        with self.changing() as db:
            self._plan(db, visits)
            self.note(db, "planned", visits=[visit.number for visit in visits])

    def replan(self, planned: Sequence[PlannedReading], visit: Visit) -> None:
        """Plan readings of one visit in another visit, because the first cannot provide them.

        The new visit has the same readings. It may have the number of the old one if nothing was attempted there.
        """
        wanted = [(each.target, each.base_target) for each in planned]
        visit = replace(
            visit,
            targets=tuple(target for target, _ in wanted),
            base_targets=tuple(base for _, base in wanted if base is not None),
        )
        with self.changing() as db:
            for each, again in zip(planned, self._plan(db, [visit]), strict=True):
                db.execute("UPDATE pose SET replaced_by = ? WHERE id = ?", (again, each.id))
                self.seals.row(db, "pose", each.id)
            self.note(
                db, "replanned", poses=[each.id for each in planned], visit=visit.number, name=visit.name
            )

    def _plan(self, db: sqlite3.Connection, visits: Sequence[Visit]) -> list[int]:
        made: list[int] = []
        for visit in visits:
            columns = (json.dumps(x) for x in (visit.joints_deg, visit.sides, visit.approach_deg))
            waypoints = json.dumps(visit.waypoints) if visit.waypoints else None
            shared = (visit.number, visit.name, visit.kind, visit.set, visit.block, *columns, waypoints)
            for reading in visit.readings:
                (planned,) = db.execute(
                    "INSERT INTO pose (visit, name, kind, set_name, block, joints_deg, sides, approach_deg, waypoints, "
                    "target, base_target) VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?, ?, ?) RETURNING id",
                    (*shared, *reading),
                ).fetchone()
                self.seals.row(db, "pose", planned)
                made.append(planned)
        return made

    def _replace(self, db: sqlite3.Connection, pose: int, reason: str) -> int:
        columns = "visit, name, kind, set_name, block, target, base_target, joints_deg, sides, approach_deg, waypoints"
        (again,) = db.execute(
            f"INSERT INTO pose ({columns}) SELECT {columns} FROM pose WHERE id = ? RETURNING id", (pose,)
        ).fetchone()
        db.execute("UPDATE pose SET replaced_by = ?, reason = ? WHERE id = ?", (again, reason, pose))
        for each in (pose, again):
            self.seals.row(db, "pose", each)
        return again

    # -- world frame --------------------------------------------------------------------------------------

    @cached_property
    def driven_by_hand(self) -> bool:
        """Whether a person drives the robot; the joints that they report then count as commanded."""
        return self.cell.robot.declared.by_hand

    @cached_property
    def cell(self) -> Cell:
        """The cell with which the campaign was begun.

        Raises
        ------
        ConfigError
            The stored text cannot be used.
        """
        return cell_of_record(self.campaign["cell"], str(self.database.path))

    @property
    def world(self) -> WorldFrame | None:
        """The world frame of the tracker; None before the nests were measured."""
        text = self.campaign["world"]
        return None if text is None else WorldFrame.from_json(text)

    @property
    def world_nests_mm(self) -> dict[str, Point] | None:
        """The nests from which the world frame was built, tracker frame, mm."""
        nests = json.loads(self.campaign["world"] or "{}").get("nests_mm")
        return None if nests is None else {name: tuple(point) for name, point in nests.items()}

    def set_world(self, world: WorldFrame, nests_mm: Mapping[str, Point], *, new_station: bool) -> None:
        """Set the world frame of all later readings; `new_station` if the instrument has moved."""
        table = json.loads(world.as_json()) | {"nests_mm": nests_mm}
        with self.changing() as db:
            db.execute(
                "UPDATE campaign SET world = ?, station = station + ?", (json.dumps(table), int(new_station))
            )
            self.seals.campaign(db)
            self.note(db, "world_frame", **table)

    def nests_mm(self) -> dict[str, Point]:
        """Return the nests of the world frame as measured last, tracker frame, mm."""
        rows = self.database.query(
            "SELECT target, tracker_x_mm, tracker_y_mm, tracker_z_mm FROM attempt JOIN pose ON "
            "pose.id = attempt.pose WHERE pose.kind = 'nest' AND pose.status = 'measured' "
            "AND pose.replaced_by IS NULL AND attempt.status = 'good'"
        )
        return {row[0]: (row[1], row[2], row[3]) for row in rows}

    def measure_nests_again(self, reason: str) -> None:
        """Plan every nest that was measured again."""
        nests = self._planned(f"{_OF_NESTS} AND status = 'measured' ORDER BY id", ())
        self.measure_again([each.id for each in nests], reason)


@dataclass(frozen=True)
class PlannedReading:
    """A planned reading: a target in a visit, and its status."""

    id: int
    visit: Visit
    target: str
    status: str
    base_target: str | None = None  # of a distance


def planned_of(rows: Iterable[sqlite3.Row]) -> list[PlannedReading]:
    """Return the planned readings of rows of `pose`.

    The rows of one visit follow one another; their readings share it.
    """
    out: list[PlannedReading] = []
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
            PlannedReading(each["id"], visit, each["target"], each["status"], each["base_target"])
            for each in readings
        ]
    return out


@dataclass(frozen=True)
class Event:
    """An event; `id` grows without end and is the version of the record."""

    id: int
    utc: float
    t_s: float | None
    kind: str
    data: Mapping[str, Any]

    def as_dict(self) -> dict[str, Any]:
        """Return the event for JSON lines and server-sent events."""
        return {"id": self.id, "utc": self.utc, "t_s": self.t_s, "kind": self.kind, "data": dict(self.data)}


@dataclass(frozen=True)
class EventTime:
    """The current time.

    `utc` is the calendar time, s since 1970; `t_s` is the campaign time, s, None before its start.
    """

    utc: float
    t_s: float | None = None
