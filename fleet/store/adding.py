"""Insertion of documents into the tables.

Existing rows are looked up first; the others are inserted in a few statements.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any

import sqlalchemy as sa
from sqlalchemy import exc

from calib.errors import DataError
from fleet.store import tables
from fleet.store.document import AddResult, Document, RobotKey, utc_now
from fleet.store.rows import Rows

_MANY = 1000  # hashes in one question
_DEADLOCK = "40P01"  # PostgreSQL has ended this one of two that wait for each other: for their identities


class ConcurrentInsert(Exception):
    """Another program has added the same document, identity or robot in the meantime."""


def already(connection: sa.Connection, hashes: Sequence[str]) -> dict[str, tuple[int, str, int]]:
    """Return number, kind and robot of the existing documents with these hashes."""
    d = tables.document.c
    found: dict[str, tuple[int, str, int]] = {}
    for begin in range(0, len(hashes), _MANY):
        some = sa.select(d.hash, d.id, d.kind, d.robot).where(d.hash.in_(hashes[begin : begin + _MANY]))
        found.update({row.hash: (row.id, row.kind, row.robot) for row in connection.execute(some)})
    return found


def _versions(connection: sa.Connection, identities: Sequence[str]) -> dict[str, list[str]]:
    """Return the hashes of each identity, oldest first."""
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
        raise ConcurrentInsert from error
    except exc.OperationalError as error:
        if getattr(error.orig, "sqlstate", None) != _DEADLOCK:
            raise
        raise ConcurrentInsert from error


def _robots(connection: sa.Connection, keys: Sequence[RobotKey]) -> dict[RobotKey, int]:
    """Return the numbers of robots; missing ones are created."""
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


def added(connection: sa.Connection, documents: Sequence[Document], rows: Sequence[Rows]) -> list[AddResult]:
    """Insert the documents that are new, within a transaction.

    Raises
    ------
    ConcurrentInsert
        Another program inserted the same rows, or a deadlock occurred.
    DataError
        The store has the content of a document for another robot or kind.
    """
    robots = _robots(connection, [each.robot for each in documents])
    there = already(connection, [each.hash for each in documents])
    versions = _versions(connection, list({each.identity for each in documents}))
    taken: dict[str, tuple[str, int]] = {h: (kind, robot) for h, (_, kind, robot) in there.items()}
    answers: list[AddResult] = []
    new: list[tuple[Document, Rows, int]] = []
    now = utc_now()
    for each, its in zip(documents, rows, strict=True):
        others = tuple(h for h in versions[each.identity] if h != each.hash)
        if each.hash in taken:
            if taken[each.hash] != (each.kind, robots[each.robot]):
                raise DataError(
                    f"is in the store already, as {taken[each.hash][0]} or of another robot.",
                    do="Find out which record and robot it belongs to, and send it under these.",
                    file=f"{each.kind} {each.identity}",
                )
            answers.append(AddResult(each.hash, "known", others))
            continue
        versions[each.identity].append(each.hash)
        taken[each.hash] = (each.kind, robots[each.robot])
        new.append((each, its, len(versions[each.identity])))
        answers.append(AddResult(each.hash, "conflict" if others else "new", others))
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
    numbers = already(connection, [each.hash for each, _, _ in new])
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
