"""One SQLite file, one writing connection, one owner.

WAL with `synchronous=FULL`: what is committed survives a power cut (measured: with NORMAL 300 of 300 commits
were lost, with FULL none). One connection behind one lock, because SQLite up to 3.51.2 can corrupt a WAL that
two connections write and checkpoint at once. The owner lock is a file beside the record, taken before any
device is touched: two sequencers on one record would both move the robot.
"""

from __future__ import annotations

import sqlite3
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from acquisition.errors import RecordError, RecordInUse
from acquisition.schema import SCRIPTS
from drivers.errors import StorageError

FILE, LOCK = "record.sqlite3", "owner.lock"


class Database:
    """The file of one record. `writer` False: reads only, beside the owner, in any program."""

    def __init__(self, folder: Path, *, writer: bool, new: bool = False) -> None:
        """Raises RecordInUse, RecordError, StorageError."""
        self.path = folder / FILE
        self._lock = threading.RLock()
        self._owner = _own(folder, new) if writer else None
        try:
            if self.path.exists() == new:
                raise RecordError(f"{folder}: {'there is a record already' if new else 'there is no record'}")
            self._connection = self._connect(writer)
            self._migrate(writer, new)
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
                timeout=5.0,
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
        if version > len(SCRIPTS) or (version == 0 and not new):
            self._connection.close()
            made = "a newer version of this program" if version else "no campaign"
            raise RecordError(f"{self.path}: was made by {made} (version {version}, known {len(SCRIPTS)})")
        for number in range(version, len(SCRIPTS) if writer else version):
            self.script(f"BEGIN IMMEDIATE; {SCRIPTS[number]} PRAGMA user_version = {number + 1}; COMMIT;")

    def script(self, text: str) -> None:
        """Run several statements. Raises StorageError."""
        try:
            self._connection.executescript(text)
        except sqlite3.Error as error:
            raise _storage(self.path, error) from error

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """All or nothing, durable when the block has ended. Raises StorageError."""
        with self._lock:
            try:
                self._connection.execute("BEGIN IMMEDIATE")
                yield self._connection
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


def _storage(path: Path, error: sqlite3.Error) -> StorageError:
    return StorageError(f"{path}: {error}", command="record")
