"""The salvage of a damaged record: row by row, from a copy, believing only what agrees with its checksum.

A page that is lost takes its rows along and ends a question that meets it; then every row is asked for by its number.
A journal (`-wal`) may hold the latest readings, or be of another record: the copy is read with it and without, and
the one with more good readings counts. A file of which only the start was overwritten is given a new header: the rest
of its first page says which tables there are. The record itself is never written to.
"""

from __future__ import annotations

import os
import shutil
import sqlite3
from collections.abc import Iterator, Mapping
from contextlib import closing
from dataclasses import dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from acquisition.errors import StorageError
from acquisition.record import seal
from acquisition.record.database import FILE

Row = dict[str, Any]

TABLES = ("campaign", "device", "pose", "attempt", "chunk", "prompt", "command", "event")
_HEADER_SIZE = 100
_PAGE_SIZE = 4096  # of every record that this program makes
_ROWS_A_PAGE = 50  # more than any of its rows leave room for


@dataclass(frozen=True)
class Salvage:
    """The rows of every table that could be read; damaged: those of them that do not agree with their checksum.

    lost: how many rows could not be read, by table; None where nothing says. campaign: None where it cannot be
    believed; without cell and plan a number means nothing.
    """

    campaign: Row | None
    rows: Mapping[str, list[Row]] = field(default_factory=dict)
    damaged: Mapping[str, frozenset[int]] = field(default_factory=dict)
    lost: Mapping[str, int | None] = field(default_factory=dict)

    def sound(self, table: str) -> list[Row]:
        """The rows that may be believed."""
        wrong = self.damaged.get(table, frozenset())
        return [row for row in self.rows.get(table, ()) if row.get("id") not in wrong]

    @property
    def readings(self) -> list[int]:
        """Ids of the good readings of poses that can be saved: with their plan and their arrival."""
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
        """Number of readings of poses that there once were, as far as plan and attempts say."""
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
    """Read what can be read of the record in a folder. Raises StorageError where not even its bytes can be."""
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
                one = _read(copy)
                if found.campaign is None or len(one.readings) > len(found.readings):
                    found = one
        except OSError as error:
            raise StorageError(
                f"{error.filename or path}: cannot be read ({error.strerror})",
                what_to_do="Give the user of this program the right to read it, or put back a copy.",
            ) from error
    return found


def _mend_header(copy: Path) -> None:
    """The first 100 bytes as SQLite writes them, where they are not: the rest of the file may be whole.

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


def _read(copy: Path) -> Salvage:
    with closing(sqlite3.connect(copy)) as db:
        db.row_factory = sqlite3.Row
        db.execute("PRAGMA writable_schema = ON")  # else SQLite refuses a whole file that was cut short
        db.text_factory = lambda text: text.decode("utf-8", "replace")  # a checksum will show damage
        rows: dict[str, list[Row]] = {}
        lost: dict[str, int | None] = {}
        for table in TABLES:
            rows[table], lost[table] = _rows(
                db, table, most=_ROWS_A_PAGE * (copy.stat().st_size // _PAGE_SIZE + 1)
            )
    campaign = _upgraded(rows["campaign"][0], rows) if rows["campaign"] else None
    if campaign is None or not seal.campaign_agrees(campaign):
        return Salvage(None, rows, {}, lost)
    damaged = {
        table: frozenset(
            row["id"] for row in rows[table] if not seal.agrees(campaign, table, {"checksum": None} | row)
        )
        for table in seal.SEALED
    }
    return Salvage(campaign, rows, damaged, lost)


def _upgraded(campaign: Row, rows: Mapping[str, list[Row]]) -> Row:
    """A campaign of a record from before there were checksums: all its rows are taken as they are."""
    last = {f"unsealed_{t}s": max((row["id"] for row in rows[t]), default=0) for t in seal.SEALED}
    return {"checksum": None, "world": None} | last | campaign


def _rows(db: sqlite3.Connection, table: str, most: int) -> tuple[list[Row], int | None]:
    """The rows of a table that can be read, and how many cannot. `most`: more than it can have."""
    try:
        return [dict(row) for row in db.execute(f"SELECT * FROM {table} ORDER BY rowid")], 0
    except sqlite3.Error as error:
        if str(error) in (
            "no such table: device",
            "no such table: chunk",
        ):  # of records before versions 4 and 5
            return [], 0
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
    """The highest row number, from whichever place still gives it."""
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
