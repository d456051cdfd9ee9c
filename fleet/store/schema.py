"""The version of a store: which migrations it has seen, and what is done where they are not those of this program."""

from __future__ import annotations

from pathlib import Path

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory

from fleet.errors import StoreError
from fleet.store.engine import WRITES, engine_of, refusals, shown
from fleet.store.roles import give_rights

_SCRIPTS = Path(__file__).parent / "migrations"
_VERSIONS = "alembic_version"
_LOCK = 0x74727565  # of PostgreSQL: two migrations at once wait for each other


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
