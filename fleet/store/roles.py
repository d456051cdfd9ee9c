"""The rights of users of a PostgreSQL: roles without a login, which its administrator gives to users.

    truepose_reader   reads everything
    truepose_writer   reads, puts documents and results in, claims jobs; changes and deletes no document

Whoever runs the migrations owns the tables. An SQLite file has no roles: who may open it may write it.
"""

from __future__ import annotations

import sqlalchemy as sa

from fleet.errors import StoreError
from fleet.store import tables
from fleet.store.engine import shown

READER, WRITER = "truepose_reader", "truepose_writer"
_CHANGED = (tables.claim.name,)  # what a writer may change: who works on what


def give_rights(connection: sa.Connection, engine: sa.Engine, *, make: bool) -> None:
    """Give the roles their rights in this database, and make those that are missing (`make`). Raises StoreError."""
    if engine.dialect.name != "postgresql":
        if make:
            raise StoreError(
                "is an SQLite file, which has no roles.",
                do="Leave --roles out; the rights of the file decide who may write.",
                file=shown(engine.url),
            )
        return
    known = set(connection.execute(sa.text("SELECT rolname FROM pg_roles")).scalars())
    for role in (READER, WRITER):
        if make and role not in known:
            connection.execute(sa.text(f"CREATE ROLE {role} NOLOGIN"))
            known.add(role)
    schema = connection.execute(sa.text("SELECT quote_ident(current_schema())")).scalar_one()
    for role in {READER, WRITER} & known:
        connection.execute(sa.text(f"GRANT USAGE ON SCHEMA {schema} TO {role}"))
        connection.execute(sa.text(f"GRANT SELECT ON ALL TABLES IN SCHEMA {schema} TO {role}"))
    if WRITER in known:
        names = ", ".join(table.name for table in tables.METADATA.sorted_tables)
        connection.execute(sa.text(f"GRANT INSERT ON {names} TO {WRITER}"))
        connection.execute(sa.text(f"GRANT UPDATE ON {', '.join(_CHANGED)} TO {WRITER}"))
        connection.execute(sa.text(f"GRANT USAGE ON ALL SEQUENCES IN SCHEMA {schema} TO {WRITER}"))
