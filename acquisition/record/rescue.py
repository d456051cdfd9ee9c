"""A new record from the readable rows of a damaged one, and a sentence on every loss.

The damaged record is read row by row, from a copy. Only rows that agree with their checksum count as good. A lost page
takes its rows along and ends a query that meets it; then every row is requested by its number. A journal (`-wal`) may
hold the latest readings, or be of another record. The copy is therefore read with and without it, and the result with
more good readings is used. A file of which only the start was overwritten is given a new header: the rest of its first
page lists the tables.

Good rows are copied as they are, with their checksums. A reading that no longer agrees with its own stays as a failed
attempt without its values, so that the data set has it as `rejected:damaged`. Its planned reading, as every one whose
reading is lost, is abandoned for that reason. Nothing is measured again automatically. Facts that the damage may have
revoked are not used: a reading whose successor is lost is left out, and a campaign that was running is paused.
"""

from __future__ import annotations

import json
import os
import shutil
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, closing, suppress
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from acquisition.errors import DamagedRecord, RecordError, StorageError
from acquisition.record import seal
from acquisition.record.database import FILE, Database, own, refuse_version
from acquisition.record.export import export
from acquisition.record.schema import UNSEALED, VERSION
from acquisition.record.states import State
from acquisition.record.store import RecordStore

Row = dict[str, Any]

TABLES = ("campaign", "device", "pose", "attempt", "chunk", "prompt", "command", "event")
_HEADER_SIZE = 100
_PAGE_SIZE = 4096  # of every record that this program makes
_ROWS_A_PAGE = 50  # more than any of its rows leave room for


@dataclass(frozen=True)
class Salvage:
    """The rows of every table that could be read.

    Attributes
    ----------
    campaign
        The campaign; None if it cannot be trusted. Without cell and plan a number has no meaning.
    rows
        The rows by table.
    damaged
        Those of them that do not agree with their checksum.
    lost
        Number of rows that could not be read, by table; None if it is not known.
    """

    campaign: Row | None
    rows: Mapping[str, list[Row]] = field(default_factory=dict)
    damaged: Mapping[str, frozenset[int]] = field(default_factory=dict)
    lost: Mapping[str, int | None] = field(default_factory=dict)

    def sound(self, table: str) -> list[Row]:
        """Return the rows that can be trusted."""
        wrong = self.damaged.get(table, frozenset())
        return [row for row in self.rows.get(table, ()) if row.get("id") not in wrong]

    @property
    def readings(self) -> list[int]:
        """Ids of the good readings of poses that can be saved, with their plan and their arrival."""
        if self.campaign is None:
            return []
        poses = {row["id"] for row in self.sound("pose") if row["kind"] == "pose"}
        arrivals = {row["id"] for row in self.sound("attempt") if row["kind"] == "arrive"}
        return [
            row["id"]
            for row in self.sound("attempt")
            if row["kind"] == "measure" and row["status"] == "good"
            if row["pose"] in poses and row["arrival"] in arrivals
        ]

    @property
    def measured(self) -> int:
        """Number of readings of poses that once existed, according to plan and attempts."""
        planned = {
            row["id"]
            for row in self.rows.get("pose", ())
            if row["kind"] == "pose" and row["status"] == "measured"
        }
        made = {
            row["pose"]
            for row in self.rows.get("attempt", ())
            if row["arrival"] is not None and row["status"] == "good"
        }
        return len(planned | made)


def salvage(folder: Path) -> Salvage:
    """Read the intact rows of the record in a folder.

    Raises
    ------
    StorageError
        Not even the bytes of the file can be read.
    RecordError
        The record has another version.
    """
    path = folder / FILE
    journal = path.with_name(f"{FILE}-wal")
    found = Salvage(None)
    with TemporaryDirectory(prefix="truepose-salvage-") as name:
        try:
            for with_journal in (True, False) if journal.is_file() else (False,):
                copy = Path(name) / f"{int(with_journal)}.sqlite3"
                shutil.copyfile(path, copy)
                if with_journal:
                    shutil.copyfile(journal, copy.with_name(f"{copy.name}-wal"))
                _mend_header(copy)
                one = _read(copy, path)
                if found.campaign is None or len(one.readings) > len(found.readings):
                    found = one
        except OSError as error:
            raise StorageError(
                f"{error.filename or path}: cannot be read ({error.strerror})",
                what_to_do="Give the user of this program the right to read it, or put back a copy.",
            ) from error
    return found


def _mend_header(copy: Path) -> None:
    """Write the first 100 bytes of a SQLite file if they are damaged; the rest may be intact.

    Source: "Database File Format", section 1.3, sqlite.org/fileformat.html.
    """
    with copy.open("r+b") as file:
        pages = os.fstat(file.fileno()).st_size // _PAGE_SIZE
        if pages == 0 or file.read(16) == b"SQLite format 3\0":
            return
        head = b"SQLite format 3\0" + _PAGE_SIZE.to_bytes(2, "big") + bytes([2, 2, 0, 64, 32, 32])
        numbers = [1, pages, 0, 0, 1, 4, 0, 0, 1, 0, 0, 0]  # changes, pages, free list, schema, format, UTF-8
        head += b"".join(n.to_bytes(4, "big") for n in numbers) + bytes(20)
        head += (1).to_bytes(4, "big") + sqlite3.sqlite_version_info[0].to_bytes(4, "big")
        file.seek(0)
        file.write(head[:_HEADER_SIZE])


def _read(copy: Path, path: Path) -> Salvage:
    with closing(sqlite3.connect(copy)) as db:
        version = 0  # as a header that was mended says
        with suppress(sqlite3.Error):
            version = db.execute("PRAGMA user_version").fetchone()[0]
        db.row_factory = sqlite3.Row
        db.execute("PRAGMA writable_schema = ON")  # otherwise SQLite refuses a whole file that was cut short
        db.text_factory = lambda text: text.decode("utf-8", "replace")  # a checksum will show damage
        rows: dict[str, list[Row]] = {}
        lost: dict[str, int | None] = {}
        for table in TABLES:
            rows[table], lost[table] = _rows(
                db, table, most=_ROWS_A_PAGE * (copy.stat().st_size // _PAGE_SIZE + 1)
            )
    campaign = rows["campaign"][0] if rows["campaign"] else None
    if campaign is not None:
        refuse_version(path, UNSEALED if campaign.get("unsealed_poses") else version or VERSION)
    if campaign is None or not seal.campaign_agrees(campaign):
        return Salvage(None, rows, {}, lost)
    damaged = {
        table: frozenset(row["id"] for row in rows[table] if not seal.agrees(campaign, table, row))
        for table in seal.SEALED
    }
    return Salvage(campaign, rows, damaged, lost)


def _rows(db: sqlite3.Connection, table: str, most: int) -> tuple[list[Row], int | None]:
    """Return the readable rows of a table, and the number of the others.

    `most` is more than the number of rows that the table can have.
    """
    try:
        return [dict(row) for row in db.execute(f"SELECT * FROM {table} ORDER BY rowid")], 0
    except sqlite3.Error:
        last = _last_number(db, table)
    found = list(_one_by_one(db, table, last or most))
    return found, None if last is None else max(0, last - len(found))


def _one_by_one(db: sqlite3.Connection, table: str, last: int) -> Iterator[Row]:
    for number in range(1, last + 1):
        try:
            row = db.execute(f"SELECT * FROM {table} WHERE rowid = ?", (number,)).fetchone()
        except sqlite3.Error:
            continue
        if row is not None:
            yield dict(row)


def _last_number(db: sqlite3.Connection, table: str) -> int | None:
    """Return the highest row number from the table, or from the sequence of SQLite."""
    for question in (
        f"SELECT max(rowid) FROM {table}",
        f"SELECT seq FROM sqlite_sequence WHERE name = '{table}'",
    ):
        try:
            row = db.execute(question).fetchone()
        except sqlite3.Error:
            continue
        if row is not None and row[0] is not None:
            return row[0]
    return None


DAMAGED = "damaged"
_OF_AN_ATTEMPT = ("id", "pose", "arrival", "began_utc", "began_t_s")  # the columns kept from a damaged one
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
    """The result of a rescue.

    `saved` of `measured` readings were saved; `lost` has a sentence on each loss.
    """

    saved: int
    measured: int
    lost: tuple[str, ...]


def rescue(record: Path, out: Path) -> Rescue:
    """Save the readable part of a record in `out`.

    This is a new record in a new folder, or a data set if the name ends in .csv.

    Raises
    ------
    RecordInUse
        Another program runs the campaign.
    RecordError
        `out` is not empty, or there is no record.
    DamagedRecord
        The campaign itself is lost.
    StorageError
        The record cannot be read.
    OSError
        A file cannot be written.
    """
    if not record.is_dir():
        raise RecordError(f"{record}: there is no record")
    if out.resolve() == record.resolve():
        raise RecordError(f"{out}: is the damaged record itself", what_to_do="Name a new folder.")
    with ExitStack() as stack:
        with suppress(StorageError):  # a folder that cannot be written has no other writer either
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
    """Write the new record, and return the losses."""
    assert found.campaign is not None
    store = RecordStore(Database(out, writer=True, new=True))
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
    """Copy all rows that can be trusted, and return their number by table."""
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
    """Return planned readings, the last first, without those whose replacement is lost."""
    kept: dict[int, Row] = {}
    for row in sorted(poses, key=lambda row: -row["id"]):
        if row.get("replaced_by") is None or row["replaced_by"] in kept:
            kept[row["id"]] = row
    return list(kept.values())


def _attempts(found: Salvage, campaign: Row, poses: dict[int, Row]) -> list[Row]:
    """Return the attempts that a record can have, in order; a damaged reading as a failed one."""
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
    """Insert a row, and return False if the constraints of a record forbid it."""
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
    """Set the state that the campaign had, or PAUSED if it was active."""
    known = {state.value for state in State} - {state.value for state in State if state.active}
    state = campaign["state"] if campaign["state"] in known else State.PAUSED.value
    reason = f"Rescued: {'; '.join(lost) or 'nothing was lost'}."
    db.execute("UPDATE campaign SET state = ?, reason = ?", (state, reason))
