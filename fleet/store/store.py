"""A store: each document is stored once and can be requested by robot, kind and time."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from datetime import datetime

import sqlalchemy as sa

from calib.errors import DataError
from fleet.errors import StoreError, StoreGone
from fleet.store import tables
from fleet.store.adding import ConcurrentInsert, added, already
from fleet.store.document import (
    AddResult,
    Document,
    DocumentSummary,
    Kind,
    NamedCause,
    RobotKey,
    RobotSummary,
    TrendPoint,
    VerdictRecord,
)
from fleet.store.engine import (
    WRITES,
    carried_over,
    engine_of,
    newest,
    reading,
    refusals,
    shown,
    version,
    writing,
)
from fleet.store.robot_state import RobotState, points_of, standings
from fleet.store.rows import rows_of
from fleet.store.work import Work

_TRIES = 20  # of a batch of which another program has just added a part


class FleetStore:
    """A store of documents, for several threads and several programs at once.

    Every method raises StoreGone if the database does not answer or is full (nothing was kept then: repeat the call),
    and StoreError if it refuses.
    """

    def __init__(self, engine: sa.Engine) -> None:
        """Use a database whose tables are those of this program; see `open`."""
        self._engine = engine
        self.work = Work(engine)

    @classmethod
    def open(cls, url: str) -> FleetStore:
        """Open the store at an address: `sqlite:///FILE` or `postgresql://USER@HOST/NAME`.

        A missing SQLite file is created, and one of an older version is migrated. A PostgreSQL is not, since others use
        it too: see `migrate`.

        Raises
        ------
        StoreError
            The store has a newer version, or is another program's.
        StoreGone
            The store does not answer.
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
        """The address of the store, without its password."""
        return shown(self._engine.url)

    def close(self) -> None:
        """Close all connections."""
        self._engine.dispose()

    def __enter__(self) -> FleetStore:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def add(self, document: Document) -> AddResult:
        """Store one document; an existing one is not stored twice.

        Raises
        ------
        DataError
            The document is not of its kind, or the store has its content for another robot or kind.
        """
        return self.add_all([document])[0]

    def add_all(self, documents: Sequence[Document]) -> list[AddResult]:
        """Store documents durably, all or none of them.

        They survive a power cut when this returns. Errors are those of `add`.
        """
        rows = [rows_of(each) for each in documents]
        for _ in range(_TRIES):
            try:
                with writing(self._engine) as connection:
                    return added(connection, documents, rows)
            except ConcurrentInsert:  # another program has added the same just now
                continue
        raise StoreGone(
            "is being written by too many programs at once.",
            do="Ask again; nothing was kept.",
            file=self.place,
        )

    def content(self, hash: str) -> bytes:
        """Return the bytes of a document.

        Raises
        ------
        DataError
            The store does not have this hash.
        """
        question = (
            sa.select(tables.content.c.bytes).join(tables.document).where(tables.document.c.hash == hash)
        )
        with reading(self._engine) as connection:
            found = connection.execute(question).scalar_one_or_none()
        if found is None:
            raise DataError(f"has no document '{hash}'.", do="List those it has.", file=self.place)
        return bytes(found)

    def known(self, hashes: Sequence[str]) -> set[str]:
        """Return those of the given hashes that the store has."""
        with reading(self._engine) as connection:
            return set(already(connection, hashes))

    def named(self) -> list[RobotKey]:
        """Return the keys of all robots, by type and serial number, without reading documents."""
        r = tables.robot.c
        with reading(self._engine) as connection:
            return [
                RobotKey(*row)
                for row in connection.execute(sa.select(r.serial, r.model).order_by(r.model, r.serial))
            ]

    def robots(self, robot: RobotKey | None = None) -> list[RobotSummary]:
        """Return all robots, by type and serial number; or one."""
        d, r = tables.document.c, tables.robot.c
        its = sa.select(r.id).where(*_of(robot, None, None))
        came = sa.case((d.measured_at > d.added_at, d.added_at), else_=d.measured_at)  # a clock may be ahead
        groups = (
            sa.select(
                d.robot,
                d.cell,
                d.kind,
                sa.func.count().label("number"),
                sa.func.min(d.measured_at).label("first"),
                sa.func.max(d.measured_at).label("last"),
                sa.func.max(came).label("came"),
            )
            .where(sa.true() if robot is None else d.robot == its.scalar_subquery())
            .group_by(d.robot, d.cell, d.kind)
            .subquery()
        )
        g = groups.c
        question = (
            sa.select(r.serial, r.model, g.cell, g.kind, g.number, g.first, g.last, g.came)
            .join_from(groups, tables.robot, r.id == g.robot)
            .order_by(r.model, r.serial, g.cell)
        )
        counts: dict[RobotKey, dict[Kind, int]] = defaultdict(dict)
        cells: dict[RobotKey, dict[str, None]] = defaultdict(dict)
        first: dict[RobotKey, datetime] = {}
        last: dict[RobotKey, datetime] = {}
        came_at: dict[RobotKey, datetime] = {}
        retired: dict[RobotKey, datetime] = {}
        with reading(self._engine) as connection:
            for serial, model, cell, kind, count, earliest, latest, at in connection.execute(question):
                key = RobotKey(serial, model)
                counts[key][kind] = counts[key].get(kind, 0) + count
                if kind == "retired":
                    retired[key] = max(at, retired.get(key, at))
                    continue
                cells[key][cell] = None
                first[key] = min(earliest, first.get(key, earliest))
                last[key] = max(latest, last.get(key, latest))
                came_at[key] = max(at, came_at.get(key, at))
        return [
            RobotSummary(
                key,
                tuple(cells[key]),
                counts[key],
                first[key],
                last[key],
                key in retired and retired[key] >= came_at[key],
            )
            for key in last
        ]

    def documents(
        self,
        robot: RobotKey | None = None,
        kind: Kind | None = None,
        since: datetime | None = None,
        limit: int = 1000,
        identity: str | None = None,
    ) -> list[DocumentSummary]:
        """Return the newest `limit` documents, newest first.

        With `since`, only those measured then or later.
        """
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
        question = question.where(*_of(robot, kind, since))
        if identity is not None:
            question = question.where(d.identity == identity)
        with reading(self._engine) as connection:
            found = connection.execute(question).all()
        return [DocumentSummary(h, k, RobotKey(s, m), *rest) for h, k, s, m, *rest in found]

    def trend(
        self, robot: RobotKey, parameter: str | None = None, *, rediagnosed: bool = True
    ) -> list[TrendPoint]:
        """Return the values of one parameter of a robot, or of all (None), by name and time.

        With `rediagnosed`, a re-diagnosis of the same readings replaces the values of the cell's own model.
        """
        with reading(self._engine) as connection:
            return points_of(connection, robot, parameter, again=rediagnosed).get(robot, [])

    def standings(self, robot: RobotKey | None = None) -> list[RobotState]:
        """Return the state of every robot, or of one, by type and serial number."""
        known = self.robots(robot)
        with reading(self._engine) as connection:
            return standings(connection, known, robot)

    def verdicts(
        self, robot: RobotKey | None = None, kind: Kind | None = None, since: datetime | None = None
    ) -> list[VerdictRecord]:
        """Return the verdicts of watches and diagnoses, of one robot or of all, oldest first."""
        v, d, r, c = tables.verdict.c, tables.document.c, tables.robot.c, tables.cause.c
        question = (
            sa.select(d.id, r.serial, r.model, d.measured_at, d.kind, d.hash, v.verdict, v.in_words, v.advice)
            .join_from(tables.verdict, tables.document)
            .join(tables.robot)
            .order_by(d.measured_at, d.id)
        )
        question = question.where(*_of(robot, kind, since))
        named = sa.select(c.document, c.label, c.in_words, c.weight, c.value, c.u, c.unit).order_by(
            c.document, c.rank
        )
        asked = question.with_only_columns(d.id).order_by(None)
        causes: dict[int, list[NamedCause]] = defaultdict(list)
        with reading(self._engine) as connection:
            for number, *rest in connection.execute(named.where(c.document.in_(asked))):
                causes[number].append(NamedCause(*rest))
            found = connection.execute(question).all()
        return [
            VerdictRecord(
                RobotKey(serial, model), at, what, hash, verdict, words, advice, tuple(causes[number])
            )
            for number, serial, model, at, what, hash, verdict, words, advice in found
        ]


def _prepare(engine: sa.Engine) -> None:
    """Make sure that the tables are those of this program.

    Raises
    ------
    StoreError
        The store has another version and cannot be migrated here.
    """
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


def _of(robot: RobotKey | None, kind: Kind | None, since: datetime | None) -> list[sa.ColumnElement[bool]]:
    """Return the conditions for documents of a robot, of a kind, measured then or later.

    None means any.
    """
    d, r = tables.document.c, tables.robot.c
    conditions: list[sa.ColumnElement[bool]] = []
    if robot is not None:
        conditions += [r.serial == robot.serial, r.model == robot.model]
    if kind is not None:
        conditions.append(d.kind == kind)
    if since is not None:
        conditions.append(d.measured_at >= since)
    return conditions
