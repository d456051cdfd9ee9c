"""The version of a store: which migrations it has seen, and what is done where they are not those of this program.

The rights of users of a PostgreSQL: roles without a login, which its administrator gives to users.

    truepose_reader   reads everything
    truepose_writer   reads, puts documents and results in, claims jobs; changes and deletes no document

Whoever runs the migrations owns the tables. An SQLite file has no roles: who may open it may write it.
"""

from __future__ import annotations

from pathlib import Path

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory

from fleet.errors import StoreError
from fleet.store import tables
from fleet.store.engine import WRITES, engine_of, refusals, shown

_SCRIPTS = Path(__file__).parent / "migrations"

_VERSIONS = "alembic_version"

_LOCK = 0x74727565  # of PostgreSQL: two migrations at once wait for each other

READER, WRITER = "truepose_reader", "truepose_writer"

_CHANGED = (tables.claim.name,)  # what a writer may change: who works on what


def migrate(url: str, *, roles: bool = False) -> tuple[str, str]:
    """Bring the tables of a store to this program's version, or make them; the version before ("" for none) and after.

    All or nothing. roles: make the roles of a PostgreSQL as well; those that are there get their rights in any case.
    Raises StoreError, StoreGone.
    """
    engine = engine_of(url, forever=True)  # a step may go through every row
    try:
        with refusals(engine), engine.connect().execution_options(**WRITES) as connection, connection.begin():
            versions = carried_over(connection, engine)
            give_rights(connection, engine, make=roles)
            return versions
    finally:
        engine.dispose()


def carried_over(connection: sa.Connection, engine: sa.Engine) -> tuple[str, str]:
    """Migrate within the transaction of a connection; versions before and after. Raises StoreError."""
    if engine.dialect.name == "postgresql":
        connection.execute(sa.text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
    before = version(connection, engine)
    if before != newest():
        config = _config()
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
    return before, newest()


def version(connection: sa.Connection, engine: sa.Engine) -> str:
    """The version of a store, "" for an empty database. Raises StoreError for a newer one and another's database."""
    names = set(sa.inspect(connection).get_table_names())
    if _VERSIONS not in names:
        if names:
            raise StoreError(
                f"holds tables of something else ('{min(names)}').",
                do="Give a file or database of its own.",
                file=shown(engine.url),
            )
        return ""
    found = MigrationContext.configure(connection).get_current_revision() or ""
    known = {script.revision for script in _scripts().walk_revisions()}
    if found and found not in known:
        raise StoreError(
            f"was written by a newer version of this program (its tables are '{found}', those known here end with "
            f"'{newest()}').",
            do="Update TruePose on this computer; nothing was changed.",
            file=shown(engine.url),
        )
    return found


def newest() -> str:
    """The version of this program's tables."""
    return _scripts().get_current_head() or ""


def _scripts() -> ScriptDirectory:
    return ScriptDirectory.from_config(_config())


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(_SCRIPTS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config


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
