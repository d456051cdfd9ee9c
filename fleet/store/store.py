"""A store: documents put in once each, and asked for by robot, kind and time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from datetime import datetime
from typing import Any

import sqlalchemy as sa
from sqlalchemy import exc

from calib.errors import DataError
from fleet.errors import StoreError, StoreGone
from fleet.store import tables
from fleet.store.document import Added, Document, Entry, Kind, Known, Point, RobotKey, utc_now
from fleet.store.engine import WRITES, engine_of, refusals, shown
from fleet.store.rows import Rows, rows_of
from fleet.store.schema import carried_over, newest, version
from fleet.store.work import Work

_MANY = 1000  # hashes in one question
_TRIES = 20  # of a batch of which another program has just added a part


class Store:
    """A store of documents; may be used by several threads, and by several programs at once.

    Every method raises StoreGone where the database is away or full (nothing was kept then: ask again), StoreError
    where it refuses.
    """

    def __init__(self, engine: sa.Engine) -> None:
        """The store in a database whose tables are those of this program; see `open`."""
        self._engine = engine
        self.work = Work(engine)

    @classmethod
    def open(cls, url: str) -> Store:
        """The store at an address: `sqlite:///FILE`, made where there is none, or `postgresql://USER@HOST/NAME`.

        An SQLite file of an older version is carried over. A PostgreSQL is not, since others use it too: see
        `migrate`. Raises StoreError for one of a newer version and for another's database, StoreGone.
        """
        engine = engine_of(url)
        try:
            with refusals(engine):
                _prepare(engine)
        except StoreError:
            engine.dispose()
            raise
        return cls(engine)

    @property
    def place(self) -> str:
        """The address, without its password."""
        return shown(self._engine.url)

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def __enter__(self) -> Store:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, document: Document) -> Added:
        """Keep one document; one that is there already is not kept twice. Raises DataError for what is not of its
        kind, and for a content that the store has of another robot or as another kind."""
        return self.add_all([document])[0]

    def add_all(self, documents: Sequence[Document]) -> list[Added]:
        """Keep documents, all or none of them, durably: when this returns they survive a power cut. Raises as `add`."""
        rows = [rows_of(each) for each in documents]
        for _ in range(_TRIES):
            try:
                with self._writing() as connection:
                    return _added(connection, documents, rows)
            except _Overtaken:  # another program has added the same just now
                continue
        raise StoreGone(
            "is being written by too many programs at once.",
            do="Ask again; nothing was kept.",
            file=self.place,
        )

    def content(self, hash: str) -> bytes:
        """The bytes of a document. Raises DataError for a hash that the store has not."""
        question = (
            sa.select(tables.content.c.bytes).join(tables.document).where(tables.document.c.hash == hash)
        )
        with self._reading() as connection:
            found = connection.execute(question).scalar_one_or_none()
        if found is None:
            raise DataError(f"has no document '{hash}'.", do="List those it has.", file=self.place)
        return bytes(found)

    def known(self, hashes: Sequence[str]) -> set[str]:
        """Those of the hashes that the store has."""
        with self._reading() as connection:
            return set(_found(connection, hashes))

    def robots(self) -> list[Known]:
        """All robots, by type and serial number."""
        d, r = tables.document.c, tables.robot.c
        question = (
            sa.select(r.serial, r.model, d.cell, d.kind, sa.func.count(), sa.func.max(d.measured_at))
            .join_from(tables.document, tables.robot)
            .group_by(r.model, r.serial, d.cell, d.kind)
            .order_by(r.model, r.serial, d.cell)
        )
        counts: dict[RobotKey, dict[Kind, int]] = defaultdict(dict)
        cells: dict[RobotKey, dict[str, None]] = defaultdict(dict)
        last: dict[RobotKey, datetime] = {}
        with self._reading() as connection:
            for serial, model, cell, kind, count, latest in connection.execute(question):
                key = RobotKey(serial, model)
                counts[key][kind] = counts[key].get(kind, 0) + count
                cells[key][cell] = None
                last[key] = max(latest, last.get(key, latest))
        return [Known(key, tuple(cells[key]), counts[key], last[key]) for key in counts]

    def documents(
        self,
        robot: RobotKey | None = None,
        kind: Kind | None = None,
        since: datetime | None = None,
        limit: int = 1000,
        identity: str | None = None,
    ) -> list[Entry]:
        """The newest `limit` documents, newest first. since: measured then or later."""
        d, r = tables.document.c, tables.robot.c
        other = tables.document.alias()
        conflict = sa.exists().where(other.c.identity == d.identity, other.c.id != d.id)
        columns = (
            d.hash,
            d.kind,
            r.serial,
            r.model,
            d.cell,
            d.identity,
            d.measured_at,
            d.added_at,
            d.program,
            d.size,
        )
        question = (
            sa.select(*columns, conflict)
            .join_from(tables.document, tables.robot)
            .order_by(d.measured_at.desc(), d.id.desc())
            .limit(limit)
        )
        if robot is not None:
            question = question.where(r.serial == robot.serial, r.model == robot.model)
        if kind is not None:
            question = question.where(d.kind == kind)
        if since is not None:
            question = question.where(d.measured_at >= since)
        if identity is not None:
            question = question.where(d.identity == identity)
        with self._reading() as connection:
            found = connection.execute(question).all()
        return [Entry(h, k, RobotKey(s, m), *rest) for h, k, s, m, *rest in found]

    def trend(self, robot: RobotKey, parameter: str | None = None) -> list[Point]:
        """The values of one parameter of a robot, or of all (None), by name and time."""
        p, d, r = tables.parameter.c, tables.document.c, tables.robot.c
        question = (
            sa.select(p.measured_at, p.name, p.value, p.u, p.unit, d.hash, d.program)
            .join_from(tables.parameter, tables.robot)
            .join(tables.document, d.id == p.document)
            .where(r.serial == robot.serial, r.model == robot.model)
            .order_by(p.name, p.measured_at, p.document)
        )
        if parameter is not None:
            question = question.where(p.name == parameter)
        with self._reading() as connection:
            return [Point(*row) for row in connection.execute(question)]

    @contextmanager
    def _reading(self) -> Iterator[sa.Connection]:
        with refusals(self._engine), self._engine.connect() as connection:
            yield connection

    @contextmanager
    def _writing(self) -> Iterator[sa.Connection]:
        with (
            refusals(self._engine),
            self._engine.connect().execution_options(**WRITES) as connection,
            connection.begin(),
        ):
            yield connection


class _Overtaken(Exception):
    """Another program has added the same document, identity or robot since it was looked for."""


def _prepare(engine: sa.Engine) -> None:
    """See to it that the tables are those of this program. Raises StoreError."""
    with engine.connect() as connection:
        found = version(connection, engine)
    if found == newest():
        return
    if engine.dialect.name == "sqlite":
        with engine.connect().execution_options(**WRITES) as connection, connection.begin():
            carried_over(connection, engine)
        return
    raise StoreError(
        f"has tables of the version '{found}', this program needs '{newest()}'."
        if found
        else "has no tables yet.",
        do="Have its owner run: truepose fleet migrate URL",
        file=shown(engine.url),
    )


def _found(connection: sa.Connection, hashes: Sequence[str]) -> dict[str, tuple[int, str, int]]:
    """Of those hashes that are there: number of the document, kind, robot."""
    d = tables.document.c
    found: dict[str, tuple[int, str, int]] = {}
    for begin in range(0, len(hashes), _MANY):
        some = sa.select(d.hash, d.id, d.kind, d.robot).where(d.hash.in_(hashes[begin : begin + _MANY]))
        found.update({row.hash: (row.id, row.kind, row.robot) for row in connection.execute(some)})
    return found


def _versions(connection: sa.Connection, identities: Sequence[str]) -> dict[str, list[str]]:
    """The hashes of each identity, oldest first."""
    d = tables.document.c
    found: dict[str, list[str]] = defaultdict(list)
    for begin in range(0, len(identities), _MANY):
        some = (
            sa.select(d.identity, d.hash)
            .where(d.identity.in_(identities[begin : begin + _MANY]))
            .order_by(d.version)
        )
        for row in connection.execute(some):
            found[row.identity].append(row.hash)
    return found


def _insert(connection: sa.Connection, table: sa.Table, rows: list[dict[str, Any]]) -> None:
    if not rows:
        return
    try:
        connection.execute(sa.insert(table), rows)
    except exc.IntegrityError as error:
        raise _Overtaken from error


def _robots(connection: sa.Connection, keys: Sequence[RobotKey]) -> dict[RobotKey, int]:
    """The numbers of robots, made where there are none."""
    r = tables.robot.c

    def look() -> dict[RobotKey, int]:
        wanted = list({key.serial for key in keys})
        found: dict[RobotKey, int] = {}
        for begin in range(0, len(wanted), _MANY):
            some = sa.select(tables.robot).where(r.serial.in_(wanted[begin : begin + _MANY]))
            found.update({RobotKey(row.serial, row.model): row.id for row in connection.execute(some)})
        return found

    found = look()
    new = [key for key in sorted(set(keys)) if key not in found]
    if not new:
        return found
    _insert(connection, tables.robot, [{"serial": key.serial, "model": key.model} for key in new])
    return look()


def _added(connection: sa.Connection, documents: Sequence[Document], rows: Sequence[Rows]) -> list[Added]:
    """Put in what is new, within a transaction. Raises _Overtaken, DataError."""
    robots = _robots(connection, [each.robot for each in documents])
    there = _found(connection, [each.hash for each in documents])
    versions = _versions(connection, list({each.identity for each in documents}))
    taken: dict[str, tuple[str, int]] = {h: (kind, robot) for h, (_, kind, robot) in there.items()}
    answers: list[Added] = []
    new: list[tuple[Document, Rows, int]] = []
    now = utc_now()
    for each, its in zip(documents, rows, strict=True):
        others = tuple(h for h in versions[each.identity] if h != each.hash)
        if each.hash in taken:
            if taken[each.hash] != (each.kind, robots[each.robot]):
                raise DataError(
                    f"is in the store already, as {taken[each.hash][0]} or of another robot.",
                    do="Look from which record and robot it is, and send it as that.",
                    file=f"{each.kind} {each.identity}",
                )
            answers.append(Added(each.hash, "known", others))
            continue
        versions[each.identity].append(each.hash)
        taken[each.hash] = (each.kind, robots[each.robot])
        new.append((each, its, len(versions[each.identity])))
        answers.append(Added(each.hash, "conflict" if others else "new", others))
    new.sort(
        key=lambda each: each[0].hash
    )  # programs that add the same never wait for each other in a circle
    _insert(
        connection,
        tables.document,
        [
            {
                "hash": each.hash,
                "kind": each.kind,
                "robot": robots[each.robot],
                "cell": each.cell,
                "identity": each.identity,
                "version": number,
                "measured_at": each.measured_at,
                "added_at": now,
                "program": its.program,
                "size": len(each.content),
            }
            for each, its, number in new
        ],
    )
    numbers = _found(connection, [each.hash for each, _, _ in new])
    placed = [(each, its, numbers[each.hash][0]) for each, its, _ in new]
    _insert(connection, tables.content, [{"document": n, "bytes": each.content} for each, _, n in placed])
    _insert(
        connection,
        tables.parameter,
        [
            {**p, "document": n, "robot": robots[each.robot], "measured_at": each.measured_at}
            for each, its, n in placed
            for p in its.parameters
        ],
    )
    _insert(
        connection, tables.verdict, [{**its.verdict, "document": n} for _, its, n in placed if its.verdict]
    )
    _insert(connection, tables.cause, [{**c, "document": n} for _, its, n in placed for c in its.causes])
    return answers
