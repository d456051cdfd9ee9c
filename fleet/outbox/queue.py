"""The queue file of an outbox: documents that wait for the fleet server's acknowledgement.

It is one SQLite file on the cell PC. A document accepted by `put` survives a killed process and a power cut. Its
content leaves the file only when the server has acknowledged the same hash. The record of the cell stays the source: a
lost outbox is filled again from it, and the server recognises the documents that it has already.

A rollback journal with `synchronous=EXTRA` syncs the folder after the journal is gone: without it a power cut may undo
the last commit (sqlite.org/pragma.html, synchronous). No WAL: a sender and a person who views the list are two
processes, and SQLite up to 3.51.2 can corrupt a WAL that two connections write at once.
"""

from __future__ import annotations

import os
import sqlite3
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, Literal

from calib.errors import DataError
from fleet.store import Document, RobotKey

FILE = "outbox.sqlite3"
State = Literal["waiting", "aside", "sent"]
VERSION = 1
LARGEST = 32 * 1024 * 1024  # bytes of a document: a data set of 100,000 readings has some 20 MB
BUSY_S = 30.0  # how long another program may hold the file
_SCRIPT = """
CREATE TABLE entry (
  number INTEGER PRIMARY KEY,
  hash TEXT NOT NULL UNIQUE,
  kind TEXT NOT NULL, serial TEXT NOT NULL, model TEXT NOT NULL, cell TEXT NOT NULL,
  identity TEXT NOT NULL, measured_at TEXT NOT NULL,
  content BLOB CHECK (content IS NOT NULL OR state = 'sent'),
  state TEXT NOT NULL DEFAULT 'waiting' CHECK (state IN ('waiting', 'aside', 'sent')),
  changed_at TEXT NOT NULL,
  tries INTEGER NOT NULL DEFAULT 0,
  said TEXT NOT NULL DEFAULT ''
) STRICT;
CREATE INDEX entries_by_state ON entry (state, number);
CREATE TABLE file (
  path TEXT NOT NULL PRIMARY KEY,
  stamp TEXT NOT NULL,
  said TEXT NOT NULL
) STRICT, WITHOUT ROWID;
"""


@dataclass(frozen=True)
class QueuedDocument:
    """A document in the queue, without its content.

    `said` states why it is not acknowledged yet, or never will be.
    """

    hash: str
    kind: str
    robot: RobotKey
    identity: str
    measured_at: datetime
    size: int
    state: State
    changed_at: datetime
    tries: int
    said: str


class Outbox:
    """The queue file of one cell. Several processes may open it at once.

    Every method raises DataError if the file cannot be used: a full disk, a damaged file, a file of a newer version.
    """

    def __init__(self, path: Path) -> None:
        """Open the file, or create it; its folder must exist."""
        self.path = path
        with self._translated():
            self._connection = sqlite3.connect(
                f"{path.absolute().as_uri()}?mode=rwc", uri=True, isolation_level=None, timeout=BUSY_S
            )
        try:
            with self._translated():
                self._prepare()
        except BaseException:
            self._connection.close()
            raise

    def _prepare(self) -> None:
        self._connection.execute("PRAGMA journal_mode = DELETE")
        self._connection.execute("PRAGMA synchronous = EXTRA")
        with self._transaction() as db:
            ((version,),) = db.execute("PRAGMA user_version").fetchall()
            if version > VERSION:
                raise DataError(
                    f"was made by a newer version of this program (version {version}, known {VERSION}).",
                    do="Use that version, or a newer one.",
                    file=self.path,
                )
            if version < VERSION:
                for statement in _SCRIPT.split(";"):
                    db.execute(statement)
                db.execute(f"PRAGMA user_version = {VERSION}")
        if os.name == "posix":
            _sync(self.path.absolute().parent)

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def __enter__(self) -> Outbox:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    # -- in ---------------------------------------------------------------------------------------------------

    def put(self, document: Document, now: datetime) -> bool:
        """Store a document durably, and return whether it is new; the same content is stored once.

        Raises
        ------
        DataError
            No server accepts the document.
        """
        refuse_large(document)
        return self._write(
            "INSERT OR IGNORE INTO entry (hash, kind, serial, model, cell, identity, measured_at, content, changed_at) "
            "VALUES (?, ?, ?, ?, ?, ?, ?, ?, ?)",
            (
                document.hash,
                document.kind,
                document.robot.serial,
                document.robot.model,
                document.cell,
                document.identity,
                _text(document.measured_at),
                document.content,
                _text(now),
            ),
        )

    def looked_at(self, path: Path, stamp: str) -> bool:
        """Check whether a file was read when it had this stamp."""
        return bool(self._read("SELECT 1 FROM file WHERE path = ? AND stamp = ?", (os.fsdecode(path), stamp)))

    def note(self, path: Path, stamp: str, said: str) -> None:
        """Note that a file with this stamp was read.

        `said` states why it is not sent; it is empty if it is sent.
        """
        self._write("INSERT OR REPLACE INTO file VALUES (?, ?, ?)", (os.fsdecode(path), stamp, said))

    def not_taken(self) -> list[tuple[Path, str]]:
        """Return the files that were read and not accepted, each with the reason."""
        rows = self._read("SELECT path, said FROM file WHERE said <> '' ORDER BY path")
        return [(Path(path), said) for path, said in rows]

    def look_again(self) -> None:
        """Discard the notes on files that were read and not accepted."""
        self._write("DELETE FROM file WHERE said <> ''")

    # -- out --------------------------------------------------------------------------------------------------

    def entries(self, *states: State) -> list[QueuedDocument]:
        """Return the documents in these states, oldest first."""
        marks = ", ".join("?" * len(states))
        rows = self._read(
            "SELECT hash, kind, serial, model, identity, measured_at, coalesce(length(content), 0), state, changed_at, "
            f"tries, said FROM entry WHERE state IN ({marks}) ORDER BY number",
            states,
        )
        return [
            QueuedDocument(
                row[0],
                row[1],
                RobotKey(row[2], row[3]),
                row[4],
                datetime.fromisoformat(row[5]),
                row[6],
                row[7],
                datetime.fromisoformat(row[8]),
                row[9],
                row[10],
            )
            for row in rows
        ]

    def document(self, hash_: str) -> Document:
        """Return a document that waits or was rejected.

        Raises
        ------
        KeyError
            There is no such document.
        """
        rows = self._read(
            "SELECT kind, serial, model, cell, identity, measured_at, content FROM entry "
            "WHERE hash = ? AND content IS NOT NULL",
            (hash_,),
        )
        if not rows:
            raise KeyError(hash_)
        ((kind, serial, model, cell, identity, measured_at, content),) = rows
        return Document(
            kind, RobotKey(serial, model), cell, identity, datetime.fromisoformat(measured_at), content
        )

    def acknowledged(self, hash_: str, now: datetime) -> None:
        """Remove the content of a document that the server has; its hash stays."""
        self._write(
            "UPDATE entry SET state = 'sent', content = NULL, changed_at = ?, said = '' WHERE hash = ?",
            (_text(now), hash_),
        )

    def tried(self, hash_: str, said: str) -> None:
        """Note that an attempt has failed; the document still waits."""
        self._write("UPDATE entry SET tries = tries + 1, said = ? WHERE hash = ?", (said, hash_))

    def set_aside(self, hash_: str, said: str, now: datetime) -> None:
        """Note that the server refuses the document: it is kept, and not sent again automatically."""
        self._write(
            "UPDATE entry SET state = 'aside', tries = tries + 1, said = ?, changed_at = ? "
            "WHERE hash = ? AND state = 'waiting'",
            (said, _text(now), hash_),
        )

    def retry(self, hash_: str, now: datetime) -> bool:
        """Let a rejected document wait again, and return whether there was one."""
        return self._write(
            "UPDATE entry SET state = 'waiting', changed_at = ? WHERE hash = ? AND state = 'aside'",
            (_text(now), hash_),
        )

    # -- the file ---------------------------------------------------------------------------------------------

    def _write(self, sql: str, values: Sequence[Any] = ()) -> bool:
        """Run one statement, durably, and return whether it changed anything."""
        with self._translated(), self._transaction() as db:
            db.execute(sql, values)
            ((changed,),) = db.execute("SELECT changes()").fetchall()
        return changed > 0

    def _read(self, sql: str, values: Sequence[Any] = ()) -> list[Any]:
        with self._translated():
            return self._connection.execute(sql, values).fetchall()

    @contextmanager
    def _transaction(self) -> Iterator[sqlite3.Connection]:
        db = self._connection
        db.execute("BEGIN IMMEDIATE")
        try:
            yield db
            db.execute("COMMIT")
        except BaseException:
            if db.in_transaction:  # SQLite has rolled back by itself if the disk is full
                db.execute("ROLLBACK")
            raise

    @contextmanager
    def _translated(self) -> Iterator[None]:
        """Translate errors of SQLite into errors with a remedy."""
        try:
            yield
        except sqlite3.Error as error:
            raise _refusal(self.path, error) from error


def refuse_large(document: Document) -> None:
    """Raise DataError for a document that no server accepts."""
    if len(document.content) > LARGEST:
        raise DataError(
            f"has {len(document.content) / 1024**2:.0f} MB; a document has at most {LARGEST / 1024**2:.0f}.",
            do="Split the data set by series.",
            file=document.identity,
        )


def _refusal(path: Path, error: sqlite3.Error) -> DataError:
    name = getattr(error, "sqlite_errorname", "")
    if name == "SQLITE_FULL":
        what, do = (
            "cannot take anything in: the disk is full.",
            "Make room. The records are whole, and what the outbox holds already is kept.",
        )
    elif name == "SQLITE_NOTADB" or name.startswith("SQLITE_CORRUPT"):
        what, do = (
            f"is damaged ({error}).",
            "Move it away and send again: it is filled anew from the records, and what the server has is known there.",
        )
    elif name.startswith("SQLITE_BUSY"):
        what, do = "is held by another program.", "Close that program."
    else:
        what, do = f"cannot be used ({error}).", "Look at its folder: is it there, and may you write in it?"
    return DataError(what, do=do, file=path)


def _sync(folder: Path) -> None:
    """Sync the folder of a new file: only then is its name durable."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _text(moment: datetime) -> str:
    return moment.astimezone(UTC).isoformat()
