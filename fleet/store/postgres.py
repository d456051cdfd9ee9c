"""The time limits for a PostgreSQL that does not answer, which an address may set.

    postgresql://USER@HOST/NAME?connect_timeout=5&answer_timeout=30      seconds; answer_timeout=0: for ever

A server ends a statement by itself after this time (its `statement_timeout`), for example one that waits for a lock. A
server that hangs, or a network that drops all packets, ends nothing. This end therefore stops a little later, and
closes the connection, since its state is unknown.
"""

from __future__ import annotations

from typing import Any

import psycopg
import sqlalchemy as sa
from psycopg import errors
from psycopg.abc import RV, PQGen
from sqlalchemy import event

from fleet.errors import StoreError

CONNECT_S, ANSWER_S = 5, 30
# This end waits longer than the server by this much, so that a server that lives gives the reason.
LATER_S = 2.0
CONNECT, ANSWER = "connect_timeout", "answer_timeout"
_DIGITS = 6  # eleven days; a server counts milliseconds, and not beyond 24 days
_SHOWN = 20


class _Limited(psycopg.Connection[Any]):
    """A connection that waits for an answer `answer_s` at most."""

    answer_s: float | None = None

    def wait(self, gen: PQGen[RV], interval: float = 0.1, timeout: float | None = None) -> RV:
        """Wait for an answer, as any connection does.

        Raises
        ------
        OperationalError
            No answer has come; the connection is closed.
        """
        try:
            return super().wait(gen, interval, self.answer_s if timeout is None else timeout)
        except errors.OperationalError:
            if self.answer_s is None or self.pgconn.transaction_status != psycopg.pq.TransactionStatus.ACTIVE:
                raise
            self.pgconn.finish()
            raise errors.OperationalError(f"nothing came within {self.answer_s:g} s") from None


def limited(url: sa.URL, place: str, *, forever: bool) -> sa.Engine:
    """Return the engine of a server, not yet connected.

    With `forever`, statements have no time limit (migrations).

    Raises
    ------
    StoreError
        A time limit is not valid.
    """
    connect_s, answer_s = _seconds(url, CONNECT, CONNECT_S, place), _seconds(url, ANSWER, ANSWER_S, place)
    engine = sa.create_engine(
        url.difference_update_query([CONNECT, ANSWER]),
        pool_pre_ping=True,  # a server that was away is there again without a restart of ours
        connect_args={"connect_timeout": connect_s},
    )
    unlimited = forever or answer_s == 0

    @event.listens_for(engine, "do_connect")
    def connect(_dialect: Any, _record: Any, arguments: list[Any], named: dict[str, Any]) -> _Limited:
        connection = _Limited.connect(*arguments, **named)
        if not unlimited:
            connection.answer_s = answer_s + LATER_S
            with connection.transaction():
                connection.execute(f"SET SESSION statement_timeout = {1000 * answer_s}".encode())
        return connection

    return engine


def _seconds(url: sa.URL, key: str, usual: int, place: str) -> int:
    given = url.query.get(key, str(usual))
    if not isinstance(given, str) or not given.isdecimal() or len(given) > _DIGITS:
        raise StoreError(
            f"is {str(given)[:_SHOWN]!r}.", do="Give whole seconds, 0 for no limit.", file=place, key=key
        )
    return int(given)
