"""A disk that can lose its power: SQLite on a VFS that logs every write, sync and deletion.

The content of a disk after a power cut is then a matter of arithmetic. Of a file it is everything up to the last sync,
and of the later writes any subset of sectors, in any order (`Platter.cut`). `connect` stands in for
`sqlite3.connect`, so that the record's code runs on this disk. Source: the crash tests of SQLite itself
(sqlite.org/testing.html, 3.3 crash testing), which do the same below a modified VFS.
"""

from __future__ import annotations

import random
import sqlite3
import uuid
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import apsw

SECTOR = 512
JOURNALS = ("-wal", "-journal")
Mark = tuple[Any, ...]


@dataclass(frozen=True)
class Op:
    """One order to the disk: `write`, `truncate`, `sync`, `delete` or `commit`.

    After `commit`, SQLite has reported the transaction as durable. A deletion is `for_good` if the folder is synced
    after it.
    """

    kind: str
    file: str = ""
    offset: int = 0
    data: bytes = b""
    mark: Mark = ()
    for_good: bool = False


@dataclass
class Disk:
    """Log of the orders so far.

    `before` is called with every order before it is logged, and may raise an error in the disk's place.
    """

    ops: list[Op] = field(default_factory=list)
    before: Callable[[Op], None] = lambda op: None

    def order(self, op: Op) -> None:
        self.before(op)
        self.ops.append(op)


class _File(apsw.VFSFile):
    def __init__(self, disk: Disk, name: Any, flags: list[int]) -> None:
        self._disk = disk
        super().__init__("", name, flags)
        path = name.filename() if isinstance(name, apsw.URIFilename) else name
        self._name = Path(path).name if path else ""

    def xWrite(self, data: bytes, offset: int) -> None:
        self._disk.order(Op("write", self._name, offset, bytes(data)))
        super().xWrite(data, offset)

    def xTruncate(self, newsize: int) -> None:
        self._disk.order(Op("truncate", self._name, newsize))
        super().xTruncate(newsize)

    def xSync(self, flags: int) -> None:
        self._disk.order(Op("sync", self._name))
        super().xSync(flags)

    def excepthook(self, etype: Any, evalue: Any, etraceback: Any) -> bool:
        """Ignore a failing disk if SQLite continues without it (a checkpoint that can wait)."""
        return True


class _Vfs(apsw.VFS):
    def __init__(self, name: str, disk: Disk) -> None:
        self.name, self._disk = name, disk
        super().__init__(name, "")

    def xOpen(self, name: Any, flags: list[int]) -> apsw.VFSFile:
        return _File(self._disk, name, flags)

    def xDelete(self, filename: str, syncdir: bool) -> None:
        self._disk.order(Op("delete", Path(filename).name, for_good=syncdir))
        super().xDelete(filename, syncdir)


class _Row(tuple[Any, ...]):
    """Row with values by place and by name, like `sqlite3.Row`."""

    names: tuple[str, ...]

    def __getitem__(self, key: Any) -> Any:
        return super().__getitem__(self.names.index(key) if isinstance(key, str) else key)

    def keys(self) -> tuple[str, ...]:
        return self.names


def _row(cursor: apsw.Cursor, values: tuple[Any, ...]) -> _Row:
    row = _Row(values)
    row.names = tuple(column[0] for column in cursor.get_description())
    return row


def _translated(error: apsw.Error) -> sqlite3.Error:
    kind = sqlite3.IntegrityError if isinstance(error, apsw.ConstraintError) else sqlite3.OperationalError
    out = kind(str(error))
    out.sqlite_errorname = f"SQLITE_{type(error).__name__.removesuffix('Error').upper()}"
    return out


class _Cursor:
    def __init__(self, cursor: apsw.Cursor) -> None:
        self._cursor = cursor

    def fetchone(self) -> Any:
        return self._cursor.fetchone()

    def fetchall(self) -> list[Any]:
        return self._cursor.fetchall()

    def __iter__(self) -> Iterator[Any]:
        return iter(self._cursor)


class Connection:
    """Subset of `sqlite3.Connection` that a record uses."""

    row_factory: object = None

    def __init__(
        self, disk: Disk, vfs: _Vfs, path: str, rewrite: Callable[[str], str], marks: Sequence[str]
    ) -> None:
        self._disk, self._vfs, self._rewrite = disk, vfs, rewrite  # the VFS must outlive the connection
        self._marks = marks
        self._connection = apsw.Connection(path, vfs=vfs.name)
        self._connection.row_trace = _row
        # Often, because a cut within a checkpoint is the hardest.
        self._connection.execute("PRAGMA wal_autocheckpoint = 40")

    def execute(self, sql: str, values: Sequence[Any] = ()) -> _Cursor:
        try:
            cursor = _Cursor(self._connection.execute(self._rewrite(sql), tuple(values)))
            if sql == "COMMIT":
                self._disk.ops.append(Op("commit", mark=self._mark()))
        except apsw.Error as error:
            raise _translated(error) from error
        return cursor

    def executescript(self, text: str) -> None:
        self.execute(text)

    @property
    def in_transaction(self) -> bool:
        return self._connection.in_transaction

    def close(self) -> None:
        self._connection.close()

    def _mark(self) -> Mark:
        return mark_of(lambda sql: self._connection.execute(sql).fetchall()[0][0], self._marks)


MARK = (
    "SELECT coalesce(max(id), 0) FROM event",
    "SELECT coalesce(max(id), 0) FROM attempt",
    "SELECT count(*) FROM attempt WHERE status <> 'open'",
    "SELECT count(*) FROM pose WHERE status <> 'planned'",
    "SELECT count(*) FROM prompt WHERE answer IS NOT NULL",
    "SELECT count(*) FROM command",
)


def mark_of(ask: Callable[[str], Any], marks: Sequence[str] = MARK) -> Mark:
    """Numbers that only grow, one of them with every change of a record."""
    return tuple(ask(sql) for sql in marks)


def connect(
    disk: Disk, rewrite: Callable[[str], str] = lambda sql: sql, marks: Sequence[str] = MARK
) -> Callable[..., Connection]:
    """Return a stand-in for `sqlite3.connect`, which passes each statement through `rewrite`."""
    vfs = _Vfs(f"platter-{uuid.uuid4().hex}", disk)

    def opened(place: str, **_: Any) -> Connection:
        return Connection(disk, vfs, unquote(urlsplit(place).path), rewrite, marks)

    return opened


@dataclass
class Platter:
    """Safe content of the disk, and the orders since the last sync of each file."""

    safe: dict[str, bytes] = field(default_factory=dict)
    loose: dict[str, list[Op]] = field(default_factory=dict)

    def take(self, op: Op) -> None:
        """One order more."""
        if op.kind == "sync":
            if op.file not in self.safe and op.file.endswith(JOURNALS):
                self._sync_folder()
            self.safe[op.file] = _applied(self.safe.get(op.file, b""), self.loose.pop(op.file, []))
        elif op.kind == "write" and any(each.kind == "delete" for each in self.loose.get(op.file, ())):
            self.safe.pop(op.file, None)  # a new file of the name: the old one has gone for good
            self.loose[op.file] = [op]
        elif op.kind != "commit":
            self.loose.setdefault(op.file, []).append(op)
        if op.for_good:
            self._sync_folder()

    def _sync_folder(self) -> None:
        """Make all deletions so far permanent.

        SQLite syncs the folder with the first sync of a new journal.
        """
        for name in [name for name, ops in self.loose.items() if any(op.kind == "delete" for op in ops)]:
            self.safe.pop(name, None)
            del self.loose[name]

    def cut(self, chance: random.Random) -> dict[str, bytes]:
        """Return the files after a power cut, with none, all or any sectors of the unsynced writes."""
        share = chance.choice((0.0, 1.0, chance.random()))
        out = {}
        for name in {*self.safe, *self.loose}:
            kept: list[Op] = []
            for op in self.loose.get(name, ()):
                if op.kind == "write":
                    kept += [sector for sector in _sectors(op) if chance.random() < share]
                elif chance.random() < share:
                    kept.append(op)
            if any(op.kind == "delete" for op in kept) or (name not in self.safe and not kept):
                continue
            out[name] = _applied(self.safe.get(name, b""), kept)
        return out


def _sectors(op: Op) -> Iterator[Op]:
    begin = op.offset
    end = op.offset + len(op.data)
    while begin < end:
        stop = min(end, (begin // SECTOR + 1) * SECTOR)
        yield Op("write", op.file, begin, op.data[begin - op.offset : stop - op.offset])
        begin = stop


def _applied(content: bytes, ops: Sequence[Op]) -> bytes:
    out = bytearray(content)
    for op in ops:
        if op.kind == "write":
            out.extend(bytes(max(0, op.offset + len(op.data) - len(out))))
            out[op.offset : op.offset + len(op.data)] = op.data
        elif op.kind == "truncate":
            del out[op.offset :]
    return bytes(out)
