"""The first tables."""

from __future__ import annotations

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None

_HASH = sa.String(64)
_TIME = sa.DateTime(timezone=True)


def upgrade() -> None:
    """Create the tables."""
    op.create_table(
        "robot",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("serial", sa.Text, nullable=False),
        sa.Column("model", sa.Text, nullable=False),
        sa.UniqueConstraint("serial", "model", name="one_robot"),
    )
    op.create_table(
        "document",
        sa.Column("id", sa.Integer, primary_key=True),
        sa.Column("hash", _HASH, nullable=False, unique=True),
        sa.Column("kind", sa.Text, nullable=False),
        sa.Column("robot", sa.Integer, sa.ForeignKey("robot.id"), nullable=False),
        sa.Column("cell", sa.Text, nullable=False),
        sa.Column("identity", sa.Text, nullable=False),
        sa.Column("version", sa.Integer, nullable=False),
        sa.Column("measured_at", _TIME, nullable=False),
        sa.Column("added_at", _TIME, nullable=False),
        sa.Column("program", sa.Text, nullable=False),
        sa.Column("size", sa.Integer, nullable=False),
        sa.UniqueConstraint("identity", "version", name="one_version"),
    )
    op.create_index("document_of_robot", "document", ["robot", "measured_at"])
    op.create_index("document_by_time", "document", ["measured_at"])
    op.create_index("document_counted", "document", ["robot", "cell", "kind", "measured_at"])
    op.create_table(
        "content",
        sa.Column("document", sa.Integer, sa.ForeignKey("document.id"), primary_key=True),
        sa.Column("bytes", sa.LargeBinary, nullable=False),
    )
    op.create_table(
        "parameter",
        sa.Column("robot", sa.Integer, sa.ForeignKey("robot.id"), primary_key=True),
        sa.Column("name", sa.Text, primary_key=True),
        sa.Column("measured_at", _TIME, primary_key=True),
        sa.Column("document", sa.Integer, sa.ForeignKey("document.id"), primary_key=True),
        sa.Column("value", sa.Double, nullable=False),
        sa.Column("u", sa.Double),
        sa.Column("unit", sa.Text, nullable=False),
        sqlite_with_rowid=False,
    )
    op.create_table(
        "verdict",
        sa.Column("document", sa.Integer, sa.ForeignKey("document.id"), primary_key=True),
        sa.Column("verdict", sa.Text, nullable=False),
        sa.Column("in_words", sa.Text, nullable=False),
        sa.Column("advice", sa.Text, nullable=False),
    )
    op.create_table(
        "cause",
        sa.Column("document", sa.Integer, sa.ForeignKey("document.id"), primary_key=True),
        sa.Column("rank", sa.Integer, primary_key=True, autoincrement=False),
        sa.Column("label", sa.Text, nullable=False),
        sa.Column("in_words", sa.Text, nullable=False),
        sa.Column("weight", sa.Double),
        sa.Column("value", sa.Double),
        sa.Column("u", sa.Double),
        sa.Column("unit", sa.Text, nullable=False),
    )
    op.create_table(
        "claim",
        sa.Column("key", _HASH, primary_key=True),
        sa.Column("owner", sa.Text, nullable=False),
        sa.Column("until", _TIME, nullable=False),
    )
    op.create_table(
        "result",
        sa.Column("key", _HASH, primary_key=True),
        sa.Column("task", sa.Text, nullable=False),
        sa.Column("data", _HASH, nullable=False),
        sa.Column("program", sa.Text, nullable=False),
        sa.Column("owner", sa.Text, nullable=False),
        sa.Column("finished_at", _TIME, nullable=False),
        sa.Column("seconds", sa.Double, nullable=False),
        sa.Column("bytes", sa.LargeBinary, nullable=False),
    )
    op.create_index("result_of_data", "result", ["data", "task"])
    op.create_index("result_of_program", "result", ["program", "task"])
