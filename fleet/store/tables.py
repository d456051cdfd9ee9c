"""The tables of a store after the last migration (`fleet.store.migrations`).

A test compares the two.

    robot      one robot a row
    document   one content a row: what it says of itself; `version` counts the contents of one identity
    content    the bytes of a document, apart, so that lists do not read them
    parameter  one parameter of one model a row; robot, name and time come first in its key, for trends
    verdict    what a watch or a diagnosis said
    cause      the causes or effects that it named
    claim      a job that somebody works on, until a time
    result     the result of a job, written once

Lengths, angles and temperatures are in the unit of their row; U has k = 2.
"""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import sqlalchemy as sa


class Utc(sa.types.TypeDecorator[datetime]):
    """A time with its zone. SQLite has no zones: it keeps the time in UTC."""

    impl = sa.DateTime(timezone=True)
    cache_ok = True

    def process_bind_param(self, value: datetime | None, dialect: Any) -> datetime | None:
        """Convert to UTC, for SQLite without a zone."""
        if value is None:
            return None
        try:
            moment = value.astimezone(UTC)
        except OverflowError:  # only in queries: no such time is stored
            moment = value.replace(tzinfo=UTC)
        return moment.replace(tzinfo=None) if dialect.name == "sqlite" else moment

    def process_result_value(self, value: datetime | None, dialect: Any) -> datetime | None:
        """Return the time in UTC."""
        if value is None:
            return None
        return value.replace(tzinfo=UTC) if dialect.name == "sqlite" else value.astimezone(UTC)


METADATA = sa.MetaData()
_HASH = sa.String(64)

robot = sa.Table(
    "robot",
    METADATA,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("serial", sa.Text, nullable=False),
    sa.Column("model", sa.Text, nullable=False),
    sa.UniqueConstraint("serial", "model", name="one_robot"),
)
document = sa.Table(
    "document",
    METADATA,
    sa.Column("id", sa.Integer, primary_key=True),
    sa.Column("hash", _HASH, nullable=False, unique=True),
    sa.Column("kind", sa.Text, nullable=False),
    sa.Column("robot", sa.Integer, sa.ForeignKey("robot.id"), nullable=False),
    sa.Column("cell", sa.Text, nullable=False),
    sa.Column("identity", sa.Text, nullable=False),
    sa.Column("version", sa.Integer, nullable=False),
    sa.Column("measured_at", Utc, nullable=False),
    sa.Column("added_at", Utc, nullable=False),
    sa.Column("program", sa.Text, nullable=False),
    sa.Column("size", sa.Integer, nullable=False),
    sa.UniqueConstraint("identity", "version", name="one_version"),
    sa.Index("document_of_robot", "robot", "measured_at"),
    sa.Index("document_by_time", "measured_at"),
    sa.Index("document_counted", "robot", "cell", "kind", "measured_at"),  # all that a list of robots reads
)
content = sa.Table(
    "content",
    METADATA,
    sa.Column("document", sa.Integer, sa.ForeignKey("document.id"), primary_key=True),
    sa.Column("bytes", sa.LargeBinary, nullable=False),
)
parameter = sa.Table(
    "parameter",
    METADATA,
    sa.Column("robot", sa.Integer, sa.ForeignKey("robot.id"), primary_key=True),
    sa.Column("name", sa.Text, primary_key=True),
    sa.Column("measured_at", Utc, primary_key=True),
    sa.Column("document", sa.Integer, sa.ForeignKey("document.id"), primary_key=True),
    sa.Column("value", sa.Double, nullable=False),
    sa.Column("u", sa.Double),
    sa.Column("unit", sa.Text, nullable=False),
    sqlite_with_rowid=False,  # the table is its own index
)
verdict = sa.Table(
    "verdict",
    METADATA,
    sa.Column("document", sa.Integer, sa.ForeignKey("document.id"), primary_key=True),
    sa.Column("verdict", sa.Text, nullable=False),
    sa.Column("in_words", sa.Text, nullable=False),
    sa.Column("advice", sa.Text, nullable=False),
)
cause = sa.Table(
    "cause",
    METADATA,
    sa.Column("document", sa.Integer, sa.ForeignKey("document.id"), primary_key=True),
    sa.Column("rank", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("label", sa.Text, nullable=False),
    sa.Column("in_words", sa.Text, nullable=False),
    sa.Column("weight", sa.Double),
    sa.Column("value", sa.Double),
    sa.Column("u", sa.Double),
    sa.Column("unit", sa.Text, nullable=False),
)
claim = sa.Table(
    "claim",
    METADATA,
    sa.Column("key", _HASH, primary_key=True),
    sa.Column("owner", sa.Text, nullable=False),
    sa.Column("until", Utc, nullable=False),
)
result = sa.Table(
    "result",
    METADATA,
    sa.Column("key", _HASH, primary_key=True),
    sa.Column("task", sa.Text, nullable=False),
    sa.Column("data", _HASH, nullable=False),
    sa.Column("program", sa.Text, nullable=False),
    sa.Column("owner", sa.Text, nullable=False),
    sa.Column("finished_at", Utc, nullable=False),
    sa.Column("seconds", sa.Double, nullable=False),
    sa.Column("bytes", sa.LargeBinary, nullable=False),
    sa.Index("result_of_data", "data", "task"),
    sa.Index("result_of_program", "program", "task"),
)
