"""The database of a record: one SQLite file, one writing connection, one owner.

WAL with `synchronous=FULL`: a commit survives a power cut. (Measured with NORMAL: 300 of 300 commits were lost, with
FULL none.) There is one connection behind one lock, because SQLite up to 3.51.2 can corrupt a WAL that two connections
write and checkpoint at once. A second connection only reads, so that a client that views a run, or has stopped it, does
not wait while a change is written to the disk. The owner lock is a file in the folder of the record. It is taken before
any device is touched, because two sequencers on one record would both move the robot.

A file that was cut short, overwritten or replaced by another program's is refused as a DamagedRecord, in the one place
where errors of SQLite are translated. Nothing is written to it; `record.rescue` works on a copy.

The progress of a path: its finished share, and the samples of an interrupted program.
"""

from __future__ import annotations

import errno
import hashlib
import os
import sqlite3
import stat
import threading
from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from acquisition.errors import RecordError, RecordInUse, StorageError, damaged
from acquisition.record.schema import LAST_TO_READ_OLDER, SCRIPT, UNSEALED, VERSION

if TYPE_CHECKING:
    from filelock import FileLock

FILE, LOCK = "record.sqlite3", "owner.lock"

_GLANCE_S = 0.2  # a check by `is_owned` must not prevent another owner

BUSY_S = 5.0  # how long another program may hold the file, on the wall

_TABLES = frozenset({"campaign", "pose", "attempt", "prompt", "command", "event"})  # of every version

_LOCKED = "Close the other program that has the record open (a database browser?), then resume."

_DAMAGE = "SQLITE_CORRUPT"

_MISSING = (
    "no such table",
    "no such column",
    "Could not decode",
)


class Database:
    """The file of one record.

    Without `writer`, any program can read it while the owner writes. A file of another version is refused, and is not
    changed.
    """

    def __init__(self, folder: Path, *, writer: bool, new: bool = False) -> None:
        """Open the file of a record in `folder`, or create it (`new`).

        Raises
        ------
        RecordInUse
            Another program runs this campaign.
        RecordError
            There is no record, or already one if `new`.
        StorageError
            The file cannot be read or written.
        """
        self.path = folder / FILE
        self._lock, self._reading = threading.RLock(), threading.Lock()
        self._within: int | None = None  # the thread whose transaction is open
        self._owner = own(folder, new=new) if writer else None
        try:
            if new and self.path.is_file() and not is_begun(folder):
                _remove(self.path)  # its making was interrupted before there was a campaign in it
            if (self.path.exists() if new else _look_at(self.path)) == new:
                raise RecordError(f"{folder}: {'there is a record already' if new else 'there is no record'}")
            self._connection = self._reader = self._connect("rwc" if new else "ro")
            try:
                if not new:
                    self._refuse_others()
                    if writer:  # only now: a refused file is never changed
                        self._connection.close()
                        self._connection = self._reader = self._connect("rw")
                if writer:
                    self.query("PRAGMA journal_mode = WAL")
                    self.query("PRAGMA synchronous = FULL")
                self.query("PRAGMA foreign_keys = ON")
                if new:
                    self.script(f"BEGIN IMMEDIATE; {SCRIPT} COMMIT;")
                if writer:
                    self._reader = self._connect("ro")
            except BaseException:
                self._connection.close()
                raise
            if new:
                _sync(folder)
                _sync(folder.parent)
            self._files = self._seen()
        except BaseException:
            self._release()
            raise

    def _connect(self, mode: str) -> sqlite3.Connection:
        try:
            connection = sqlite3.connect(
                f"{self.path.absolute().as_uri()}?mode={mode}",
                uri=True,
                isolation_level=None,  # transactions are ours
                check_same_thread=False,  # the lock serialises
                timeout=BUSY_S,
            )
            connection.row_factory = sqlite3.Row
        except sqlite3.Error as error:
            raise _storage(self.path, error) from error
        return connection

    def _refuse_others(self) -> None:
        """Raise RecordError or DamagedRecord for a file that is not a record of this version."""
        tables = {row[0] for row in self.query("SELECT name FROM sqlite_master WHERE type = 'table'")}
        if tables and (missing := _TABLES - tables):
            raise damaged(
                self.path,
                "is a database of another program"
                if missing == _TABLES
                else f"has lost {', '.join(sorted(missing))}",
            )
        if not tables or not self.query("SELECT 1 FROM campaign"):
            raise RecordError(f"{self.path}: holds no campaign", what_to_do="Start it again in this folder.")
        refuse_version(self.path, self.query("PRAGMA user_version")[0][0])
        if self.query("SELECT 1 FROM campaign WHERE unsealed_poses > 0"):
            refuse_version(self.path, UNSEALED)

    def script(self, text: str) -> None:
        """Run several statements.

        Raises
        ------
        StorageError
            SQLite reports an error.
        """
        try:
            self._connection.executescript(text)
        except sqlite3.Error as error:
            raise _storage(self.path, error) from error

    @contextmanager
    def transaction(self) -> Iterator[sqlite3.Connection]:
        """Open a transaction, which becomes durable as a whole or not at all.

        A transaction within another is part of it.

        Raises
        ------
        StorageError
            SQLite reports an error, or the file was removed, replaced or cut.
        """
        with self._lock:
            within = self._within is not None
            try:
                if not within:
                    self._connection.execute("BEGIN IMMEDIATE")
                    self._within = threading.get_ident()
                yield self._connection
                if not within:
                    self._connection.execute("COMMIT")
                    self._must_be_there()
            except BaseException as error:
                with suppress(sqlite3.Error):  # SQLite may have rolled back by itself (disk full)
                    self._connection.execute("ROLLBACK")
                if isinstance(error, sqlite3.Error):
                    raise _storage(self.path, error) from error
                raise
            finally:
                if not within:
                    self._within = None

    def _seen(self) -> dict[Path, os.stat_result | None]:
        """Return the system's status of the file and of its journal by path; None if one is missing."""
        found: dict[Path, os.stat_result | None] = {}
        for path in (self.path, self.path.with_name(f"{FILE}-wal")):
            try:
                found[path] = path.stat()
            except OSError:
                found[path] = None
        return found

    def _must_be_there(self) -> None:
        """Raise StorageError if the file is no longer that of its path.

        Changes would be lost with it. SQLite itself makes neither file shorter while one program writes it.
        """
        now = self._seen()
        for path, before in self._files.items():
            if before is not None and (harm := _harm(before, now[path])):
                raise StorageError(
                    f"{path}: {harm} while it was written",
                    command="record",
                    what_to_do="Put the file back where it was, or start a new record; the readings since then are "
                    "in neither.",
                )
        self._files = now

    def query(self, sql: str, values: Sequence[Any] = ()) -> list[sqlite3.Row]:
        """Return all rows of a query.

        Within a transaction of this thread, they include its changes.

        Raises
        ------
        StorageError
            SQLite reports an error.
        """
        inside = self._within == threading.get_ident()
        with self._lock if inside else self._reading:
            try:
                return (self._connection if inside else self._reader).execute(sql, values).fetchall()
            except sqlite3.Error as error:
                raise _storage(self.path, error) from error

    def close(self) -> None:
        """Close the file and release the lock."""
        with self._lock, self._reading:
            self._reader.close()
            self._connection.close()
        self._release()

    def _release(self) -> None:
        if self._owner is not None:
            self._owner.release()


def own(folder: Path, *, new: bool) -> FileLock:
    """Take the lock of a record's owner.

    Raises
    ------
    RecordInUse
        Another program runs this campaign.
    RecordError
        There is no record.
    StorageError
        The folder cannot be written.
    """
    from filelock import FileLock, Timeout  # of the extra `cell`

    try:
        if new:
            folder.mkdir(parents=True, exist_ok=True)
        elif not folder.is_dir():
            raise RecordError(f"{folder}: there is no record")
        lock = FileLock(folder / LOCK, thread_local=False)
        lock.acquire(timeout=_GLANCE_S, poll_interval=_GLANCE_S / 10)
    except Timeout as error:
        raise RecordInUse(f"{folder}: another program runs this campaign") from error
    except OSError as error:
        raise StorageError(f"{folder}: cannot be written ({error.strerror})") from error
    return lock


def is_owned(folder: Path) -> bool:
    """Check whether a program runs the campaign of this record.

    For this, the lock of the record is taken for a moment.
    """
    if not (folder / LOCK).exists():  # a copy without it: nothing is written to it
        return False
    from filelock import FileLock, Timeout

    try:
        with FileLock(folder / LOCK, thread_local=False).acquire(timeout=0):
            return False
    except (Timeout, OSError):  # a folder that cannot be written gives no information
        return True


def sha256_of(folder: Path) -> str:
    """Return the SHA-256 of a record's database in hexadecimal, with its journal applied.

    The text is empty if the database cannot be read. SQLite reads it into memory, not this program: see `_look_at`.
    """
    path = folder / FILE
    with suppress(StorageError, sqlite3.Error):
        if _look_at(path):
            with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode=ro", uri=True)) as connection:
                return hashlib.sha256(connection.serialize()).hexdigest()
    return ""


def _look_at(path: Path) -> bool:
    """Check whether there is a file before SQLite opens it.

    SQLite would discard the journal of an empty file. This function does not open the file. Under POSIX a process loses
    every lock on a file when it closes any of its handles, so that a check would take the journal from its owner.

    Raises
    ------
    DamagedRecord
        The path is a folder, or the file is empty and its journal is not.
    StorageError
        The file cannot be read.
    """
    try:
        found = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        return False
    except OSError as error:
        raise _unreadable(path, error.strerror) from error
    if stat.S_ISDIR(found.st_mode):
        raise damaged(path, "is a folder, where there should be a file")
    if not os.access(path, os.R_OK):
        raise _unreadable(path, os.strerror(errno.EACCES))
    journal = path.with_name(f"{path.name}-wal")
    if not found.st_size and journal.exists() and journal.stat().st_size:
        raise damaged(path, "is empty, its journal is not")
    return True


def _unreadable(path: Path, why: str | None) -> StorageError:
    return StorageError(
        f"{path}: cannot be read ({why})",
        what_to_do="Give the user of this program the right to read it, or look at the disk it lies on.",
    )


def is_begun(folder: Path) -> bool:
    """Check whether the file of a record has content that must be kept.

    This is a record with its campaign, a damaged one, or another program's file. A file whose making was cut off has
    none.
    """
    path = folder / FILE
    if not path.is_file():
        return False
    try:
        _look_at(path)
    except StorageError:
        return True
    # Reading only: a program that closes a writable file merges its journal. A journal of the other kind, to be rolled
    # back, has only a file whose creation was interrupted.
    mode = "rw" if path.with_name(f"{path.name}-journal").exists() else "ro"
    with closing(sqlite3.connect(f"{path.absolute().as_uri()}?mode={mode}", uri=True)) as connection:
        try:
            tables = {
                row[0] for row in connection.execute("SELECT name FROM sqlite_master WHERE type = 'table'")
            }
            if not tables >= _TABLES:
                return bool(tables)
            return connection.execute("SELECT 1 FROM campaign").fetchone() is not None
        except sqlite3.Error:
            return True


def _remove(path: Path) -> None:
    for ending in ("", "-wal", "-shm", "-journal"):
        path.with_name(path.name + ending).unlink(missing_ok=True)


def _harm(before: os.stat_result, now: os.stat_result | None) -> str:
    """Return a verb phrase for the damage to a file since `before`, or an empty text."""
    if now is None:
        return "was removed or moved"
    if (before.st_dev, before.st_ino) != (now.st_dev, now.st_ino):
        return "was replaced"
    return "was cut" if now.st_size < before.st_size else ""


def _sync(folder: Path) -> None:
    """Make the name of a new file durable by syncing its folder.

    Only POSIX needs this; other systems do it by themselves.
    """
    if os.name == "posix":
        handle = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(handle)
        finally:
            os.close(handle)


def refuse_version(path: Path, version: int) -> None:
    """Raise RecordError for a record that another version of the program wrote."""
    if version > VERSION:
        raise RecordError(
            f"{path}: was made by a newer version of this program (version {version}, known {VERSION})",
            what_to_do="Use the version of TruePose that made it, or a newer one.",
        )
    if version < VERSION:
        raise RecordError(
            f"{path}: is a record of version {version}, and this program reads version {VERSION}",
            what_to_do=f"Export it with the last program that reads it: commit {LAST_TO_READ_OLDER} of TruePose.",
        )


def _storage(path: Path, error: sqlite3.Error) -> StorageError:
    name = getattr(error, "sqlite_errorname", "")  # only errors of SQLite itself have one
    if name == "SQLITE_NOTADB":
        return damaged(path, "does not begin as a database does")
    if name.startswith(_DAMAGE) or str(error).startswith(_MISSING):
        return damaged(path, f"is damaged ({error})")
    locked = name.startswith("SQLITE_BUSY")
    return StorageError(f"{path}: {error}", command="record", what_to_do=_LOCKED if locked else None)


def share_of_path(database: Database, last: dict[str, Any] | None) -> float:
    """Return the finished share of the current path, 0 to 1, according to the last waypoint.

    It is 0 if no path is being driven.
    """
    if last is None or last["of"] < 2:
        return 0.0
    rows = database.query("SELECT status FROM attempt WHERE id = ?", (last["attempt"],))
    return (last["waypoint"] - 1) / (last["of"] - 1) if rows and rows[0]["status"] == "open" else 0.0


def streams_kept(db: sqlite3.Connection, attempt: int) -> dict[str, Any]:
    """Return the state of the streams of an attempt by role, or nothing if it has none.

    The state has the number of samples kept, the number lost, the device's clock at the last, and its arrival, campaign
    s.
    """
    rows = db.execute(
        "SELECT role, sum(samples), sum(lost), max(until_t_s), max(arrived_t_s) FROM chunk WHERE attempt = ? "
        "GROUP BY role",
        (attempt,),
    ).fetchall()
    keys = ("samples", "lost", "until_t_s", "arrived_t_s")
    return {"streams": {row[0]: dict(zip(keys, tuple(row)[1:], strict=True)) for row in rows}} if rows else {}
