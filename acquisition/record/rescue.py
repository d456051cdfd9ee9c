"""A new record of what can be read of a damaged one, and a sentence on everything that was lost.

What is saved is copied as it is, with its checksums. A reading that no longer agrees with its own stays as a failed
attempt without its values, so that the data set names it as `rejected:damaged`; its planned reading, as every one whose
reading is gone, is given up for that reason. Nothing is measured again by itself. What the damage may have unsaid is
not believed: a reading whose successor is lost is left out, and a campaign that was going on is paused.
"""

from __future__ import annotations

import json
import sqlite3
from collections.abc import Sequence
from contextlib import ExitStack, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from acquisition.errors import DamagedRecord, RecordError, StorageError
from acquisition.record import seal
from acquisition.record.database import FILE, Database, own
from acquisition.record.export import export
from acquisition.record.salvage import Row, Salvage, salvage
from acquisition.record.states import State
from acquisition.record.store import Store

DAMAGED = "damaged"
_OF_AN_ATTEMPT = ("id", "pose", "arrival", "began_utc", "began_t_s")  # what is kept of one that is damaged
_NAMES = {
    "attempt": "attempts",
    "chunk": "chunks of streams",
    "pose": "planned readings",
    "device": "devices",
    "prompt": "prompts",
    "command": "orders",
    "event": "events",
}


@dataclass(frozen=True)
class Rescue:
    """The outcome of a rescue: how many readings were saved of how many, and what was lost, in sentences."""

    saved: int
    measured: int
    lost: tuple[str, ...]


def rescue(record: Path, out: Path) -> Rescue:
    """Save what can be read into `out`: a new record in a new folder, or a data set where it ends in .csv.

    Raises RecordInUse, RecordError (`out` holds something, or there is no record), DamagedRecord (its campaign is
    lost), StorageError, OSError.
    """
    if not record.is_dir():
        raise RecordError(f"{record}: there is no record")
    if out.resolve() == record.resolve():
        raise RecordError(f"{out}: is the damaged record itself", what_to_do="Name a new folder.")
    with ExitStack() as stack:
        with suppress(StorageError):  # a folder that cannot be written is written by nobody else either
            stack.callback(own(record, new=False).release)
        found = salvage(record)
        if found.campaign is None:
            raise DamagedRecord(
                f"{record / FILE}: cell and campaign cannot be read, and without them no reading means anything",
                what_to_do="Put back a copy of the record.",
            )
        if out.suffix == ".csv":
            if not found.readings:
                raise RecordError(
                    f"{record / FILE}: not one reading of a pose can be saved",
                    what_to_do="Rescue it into a folder to keep plan and events.",
                )
            folder = Path(stack.enter_context(TemporaryDirectory(prefix="truepose-rescue-"))) / "record"
            lost = _write(found, folder, record)
            export(folder, out)
        else:
            lost = _write(found, out, record)
    return Rescue(len(found.readings), found.measured, lost)


def _write(found: Salvage, out: Path, record: Path) -> tuple[str, ...]:
    """Returns what was lost."""
    assert found.campaign is not None
    store = Store(Database(out, writer=True, new=True))
    try:
        with store.database.transaction() as db:
            copied = _fill(db, found, found.campaign)
            lost = _losses(found, copied)
            store.note(db, "rescued", record=str(record), lost=list(lost))
            _end(db, found.campaign, lost)
        seal.check(store.database)
    finally:
        store.close()
    return lost


def _fill(db: sqlite3.Connection, found: Salvage, campaign: Row) -> dict[str, int]:
    """Copy everything that may be believed; how many rows of every table that were."""
    poses = _whole_chains(found.sound("pose"))
    attempts = _attempts(found, campaign, {row["id"]: row for row in poses})
    readings = {row["pose"] for row in attempts if row["kind"] == "measure" and row["status"] == "good"}
    planned = [
        row if row["status"] != "measured" or row["id"] in readings else _given_up(row, campaign)
        for row in poses
    ]
    # Nothing is attempted unless a campaign runs, nor before its prompts are answered; a successor comes first.
    running = campaign | {"state": State.RUNNING.value, "owner": None}
    rows = {"campaign": [running], "device": found.sound("device"), "pose": planned, "attempt": attempts}
    rows |= {table: found.sound(table) for table in ("chunk", "prompt", "command")}
    rows["event"] = [row for row in found.sound("event") if _is_json(row["data"])]
    return {table: sum(_insert(db, table, row) for row in of_table) for table, of_table in rows.items()}


def _whole_chains(poses: Sequence[Row]) -> list[Row]:
    """Planned readings, the last first; one that was replaced goes with the one in its place."""
    kept: dict[int, Row] = {}
    for row in sorted(poses, key=lambda row: -row["id"]):
        if row.get("replaced_by") is None or row["replaced_by"] in kept:
            kept[row["id"]] = row
    return list(kept.values())


def _attempts(found: Salvage, campaign: Row, poses: dict[int, Row]) -> list[Row]:
    """The attempts that a record can hold, in their order; a damaged reading as one that failed."""
    sound = {row["id"]: row for row in found.sound("attempt")}
    arrivals = {n for n, row in sound.items() if row["kind"] == "arrive" and row["status"] == "good"}
    out = []
    for row in sorted(found.rows.get("attempt", ()), key=lambda row: row["id"]):
        pose = poses.get(row["pose"] or 0)
        if row["kind"] != "arrive" and (
            pose is None or (pose["kind"] == "pose" and row["arrival"] not in arrivals)
        ):
            continue
        if row["id"] in sound:
            out.append(row)
        elif row["kind"] == "measure" and pose is not None:
            failed = {name: row[name] for name in _OF_AN_ATTEMPT}
            failed |= {
                "kind": "measure",
                "visit": pose["visit"],
                "status": "failed",
                "error": DAMAGED,
                "station": 1,
            }
            out.append(failed | {"checksum": seal.checksum(campaign["id"], "attempt", failed)})
    return out


def _given_up(pose: Row, campaign: Row) -> Row:
    row = pose | {"status": "skipped", "reason": DAMAGED}
    return row | {"checksum": seal.checksum(campaign["id"], "pose", row)}


def _insert(db: sqlite3.Connection, table: str, row: Row) -> bool:
    """Whether the row is one that a record may have."""
    names = [name for _, name, *_ in db.execute(f"PRAGMA table_info({table})") if name in row]
    try:
        db.execute(
            f"INSERT INTO {table} ({', '.join(names)}) VALUES ({', '.join('?' * len(names))})",
            [row[name] for name in names],
        )
    except sqlite3.IntegrityError:
        return False
    return True


def _is_json(text: str) -> bool:
    try:
        json.loads(text)
    except ValueError:
        return False
    return True


def _losses(found: Salvage, copied: dict[str, int]) -> tuple[str, ...]:
    wrong = found.damaged.get("attempt", frozenset())
    lost = [f"reading {number} no longer agrees with its checksum" for number in sorted(wrong)]
    missing = found.measured - len(found.readings)
    if missing:
        lost.append(f"{missing} of {found.measured} readings are lost; their planned readings are given up")
    for table, name in _NAMES.items():
        unread = found.lost.get(table, 0)
        gone = (unread or 0) + len(found.rows.get(table, ())) - copied.get(table, 0)
        if unread is None:
            lost.append(f"nothing says how many {name} were lost")
        elif gone:
            lost.append(f"{gone} {name} could not be saved")
    return tuple(lost)


def _end(db: sqlite3.Connection, campaign: Row, lost: Sequence[str]) -> None:
    """The state it had, but that nothing goes on by itself."""
    known = {state.value for state in State} - {state.value for state in State if state.active}
    state = campaign["state"] if campaign["state"] in known else State.PAUSED.value
    reason = f"Rescued: {'; '.join(lost) or 'nothing was lost'}."
    db.execute("UPDATE campaign SET state = ?, reason = ?", (state, reason))
