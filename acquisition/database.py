"""One SQLite file, one writing connection, one owner.

WAL with `synchronous=FULL`: what is committed survives a power cut (measured: with NORMAL 300 of 300 commits
were lost, with FULL none). One connection behind one lock, because SQLite up to 3.51.2 can corrupt a WAL that
two connections write and checkpoint at once. The owner lock is a file beside the record, taken before any
device is touched: two sequencers on one record would both move the robot.
"""

from __future__ import annotations

import os
import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from acquisition.errors import RecordError, RecordInUse
from acquisition.schema import SCRIPTS
from drivers.errors import StorageError

FILE, LOCK = "record.sqlite3", "owner.lock"
BUSY_S = 5.0  # how long another program may hold the file, on the wall
_ADVICE = {
    "SQLITE_BUSY": "Close the other program that has the record open (a database browser?), then resume.",
    "SQLITE_CORRUPT": "Copy the whole folder before anything else, then check the disk it lies on.",
}


class Database:
    """The file of one record. `writer` False: reads only, beside the owner, in any program.

    A file of an older version is carried over when it is opened, one of a newer version is refused.
    """

    def __init__(self, folder: Path, *, writer: bool, new: bool = False) -> None:
        """Raises RecordInUse, RecordError, StorageError."""
        self.path = folder / FILE
        self._lock = threading.RLock()
        self._owner = _own(folder, new) if writer else None
        try:
            if new and self.path.exists() and not _begun(self.path):
                _remove(self.path)  # its making was interrupted before there was a campaign in it
            if self.path.exists() == new:
                raise RecordError(f"{folder}: {'there is a record already' if new else 'there is no record'}")
            self._connection = self._connect(writer)
            self._migrate(writer, new)
            if new:
                _sync(folder)
                _sync(folder.parent)
        except BaseException:
            self._release()
            raise

    def _connect(self, writer: bool) -> sqlite3.Connection:
        mode = "rwc" if writer else "ro"
        try:
            connection = sqlite3.connect(
                f"{self.path.absolute().as_uri()}?mode={mode}",
                uri=True,
                isolation_level=None,  # transactions are ours
                check_same_thread=False,  # the lock serialises
                timeout=BUSY_S,
            )
            connection.row_factory = sqlite3.Row
            if writer:
                connection.execute("PRAGMA journal_mode = WAL")
                connection.execute("PRAGMA synchronous = FULL")
            connection.execute("PRAGMA foreign_keys = ON")
        except sqlite3.Error as error:
            raise _storage(self.path, error) from error
        return connection

    def _migrate(self, writer: bool, new: bool) -> None:
        version = self.query("PRAGMA user_version")[0][0]
        if version > len(SCRIPTS):
            self._connection.close()
            made = f"a newer version of this program (version {version}, known {len(SCRIPTS)})"
            raise RecordError(
                f"{self.path}: was made by {made}",
                what_to_do="Use the version of TruePose that made it, or a newer one.",
            )
        if not new and (version == 0 or not self.query("SELECT 1 FROM campaign")):
            self._connection.close()
            raise RecordError(f"{self.path}: holds no campaign; start it anew in this folder")
        if version < len(SCRIPTS) and not writer:
            Database(self.path.parent, writer=True).close()  # carried over by an owner, then read
            return
        for number in range(version, len(SCRIPTS)):
            self.script(f"BEGIN IMMEDIATE; {SCRIPTS[number]} PRAGMA user_version = {number + 1}; COMMIT;")

    def script(self, text: str) -> None:
        """Run several statements. Raises StorageError."""
        try:
            self._connection.executescript(text)
        except sqlite3.Error as error:
            raise _storage(self.path, error) from error

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """All or nothing, durable when the block has ended; one within another is part of it. Raises StorageError."""
        with self._lock:
            try:
                within = self._connection.in_transaction
                if not within:
                    self._connection.execute("BEGIN IMMEDIATE")
                yield self._connection
                if not within:
                    self._connection.execute("COMMIT")
            except BaseException as error:
                with suppress(sqlite3.Error):  # SQLite may have rolled back by itself (disk full)
                    self._connection.execute("ROLLBACK")
                if isinstance(error, sqlite3.Error):
                    raise _storage(self.path, error) from error
                raise

    def query(self, sql: str, values: Sequence[Any] = ()) -> list[sqlite3.Row]:
        """All rows of a question. Raises StorageError."""
        with self._lock:
            try:
                return self._connection.execute(sql, values).fetchall()
            except sqlite3.Error as error:
                raise _storage(self.path, error) from error

    def close(self) -> None:
        """Close the file and give the record up."""
        with self._lock:
            self._connection.close()
        self._release()

    def _release(self) -> None:
        if self._owner is not None:
            self._owner.release()


def _own(folder: Path, new: bool) -> FileLock:
    try:
        if new:
            folder.mkdir(parents=True, exist_ok=True)
        elif not folder.is_dir():
            raise RecordError(f"{folder}: there is no record")
        lock = FileLock(folder / LOCK, thread_local=False)
        lock.acquire(timeout=0)
    except Timeout as error:
        raise RecordInUse(f"{folder}: another program runs this campaign") from error
    except OSError as error:
        raise StorageError(f"{folder}: cannot be written ({error.strerror})") from error
    return lock


def _begun(path: Path) -> bool:
    """A record with its campaign, or a file that is none of ours."""
    with closing(sqlite3.connect(path)) as connection:
        try:
            tables = connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'campaign'").fetchone()
            return tables is not None and connection.execute("SELECT 1 FROM campaign").fetchone() is not None
        except sqlite3.Error:
            return True


def _remove(path: Path) -> None:
    for ending in ("", "-wal", "-shm", "-journal"):
        path.with_name(path.name + ending).unlink(missing_ok=True)


def _sync(folder: Path) -> None:
    """The name of a new file is only durable with its folder (POSIX; other systems do it by themselves)."""
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def _storage(path: Path, error: sqlite3.Error) -> StorageError:
    name = getattr(error, "sqlite_errorname", "")  # only errors of SQLite itself have one
    advice = next((text for start, text in _ADVICE.items() if name.startswith(start)), None)
    return StorageError(f"{path}: {error}", command="record", what_to_do=advice)
