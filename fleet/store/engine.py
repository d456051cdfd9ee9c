"""The database of a store: an SQLite file or a PostgreSQL, with a common interface.

Errors of the database become errors of this package. The version of a store is the set of migrations that it has seen;
a store with other ones than this program is migrated or refused.

The rights of users of a PostgreSQL are roles without a login, which its administrator gives to users:

    truepose_reader   reads everything
    truepose_writer   reads, puts documents and results in, claims jobs; changes and deletes no document

The user who runs the migrations owns the tables. An SQLite file has no roles: any user who may open it may write it.
"""

from __future__ import annotations

import sqlite3
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from urllib.parse import unquote

import sqlalchemy as sa
from alembic import command
from alembic.config import Config
from alembic.runtime.migration import MigrationContext
from alembic.script import ScriptDirectory
from sqlalchemy import event, exc

from fleet.errors import StoreError, StoreFull, StoreGone
from fleet.store import tables

WRITES = {"writes": True}
"""Execution option of a connection that writes: SQLite then waits for other writers before it begins, not after."""

BUSY_S = 30.0  # how long another program may hold an SQLite file
_AGAIN_S = 0.05
_MISSING = 'Install it with: pip install "truepose[fleet]"'
_SCRIPTS = Path(__file__).parent / "migrations"
_VERSIONS = "alembic_version"
_LOCK = 0x74727565  # of PostgreSQL: two migrations at once wait for each other
READER, WRITER = "truepose_reader", "truepose_writer"
_CHANGED = (tables.claim.name,)  # the tables that a writer may change: claims of jobs


def engine_of(url: str, *, forever: bool = False) -> sa.Engine:
    """Return the database at an address, not yet connected.

    The address is sqlite:///FILE or postgresql://USER:PASSWORD@HOST/NAME. With `forever`, a PostgreSQL has no time
    limit; otherwise that of `fleet.store.postgres`.

    Raises
    ------
    StoreError
        It is another kind of address, an SQLite file without a folder, or the driver is missing.
    """
    try:
        parsed = sa.make_url(url)
    except exc.ArgumentError as error:
        raise StoreError(
            "is not the address of a store.",
            do="Give sqlite:///FILE or postgresql://USER@HOST/NAME.",
            key="store",
        ) from error
    place = shown(parsed)
    kind = parsed.get_backend_name()
    if kind == "sqlite":
        if not parsed.database or parsed.database == ":memory:":
            raise StoreError("names no file.", do="Give sqlite:///FILE.", file=place)
        if not Path(parsed.database).absolute().parent.is_dir():
            raise StoreError("its folder does not exist.", do="Make the folder first.", file=place)
        engine = sa.create_engine(parsed.set(drivername="sqlite"), connect_args={"timeout": BUSY_S})
        event.listen(engine, "connect", _prepare_sqlite)
        event.listen(engine, "begin", _begin_sqlite)
        return engine
    if kind != "postgresql":
        raise StoreError(
            f"is an address of {kind}.", do="Give sqlite:///FILE or postgresql://USER@HOST/NAME.", file=place
        )
    try:
        from fleet.store.postgres import limited

        return limited(parsed.set(drivername="postgresql+psycopg"), place, forever=forever)
    except ImportError as error:
        raise StoreError("the driver psycopg is not installed.", do=_MISSING, file=place) from error


def shown(url: sa.URL) -> str:
    """Return an address without its password, for people."""
    plain = url.set(drivername=url.get_backend_name())
    return unquote(plain.render_as_string(hide_password=True))


def _prepare_sqlite(connection: sqlite3.Connection, _: object) -> None:
    connection.isolation_level = None  # transactions begin in _begin_sqlite
    _write_ahead(connection)
    for statement in ("synchronous = FULL", "foreign_keys = ON"):
        connection.execute(f"PRAGMA {statement}")


def _write_ahead(connection: sqlite3.Connection) -> None:
    """Switch the file to a write-ahead log.

    SQLite does not wait here for another program that creates the same file.
    """
    until = time.monotonic() + BUSY_S
    while True:
        try:
            connection.execute("PRAGMA journal_mode = WAL")
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > until:
                raise
            time.sleep(_AGAIN_S)
        else:
            return


def _begin_sqlite(connection: sa.Connection) -> None:
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")


@contextmanager
def refusals(engine: sa.Engine) -> Iterator[None]:
    """Translate errors of the database into a StoreGone or a StoreError with place and remedy.

    Rows that exist already still raise IntegrityError.
    """
    place = shown(engine.url)
    try:
        yield
    except exc.IntegrityError:  # two at once: the writing code handles this
        raise
    except exc.DBAPIError as error:
        raise _refusal(error, place) from error
    except exc.TimeoutError as error:  # no connection was free within the time
        raise StoreGone(f"does not answer ({_first_line(error)}).", do=_LATER, file=place) from error


_LATER = "Look at the database and at the network to it, then ask again; nothing was kept."
_FULL = ("disk is full", "No space left", "could not extend file", "disk I/O error")
_RIGHTS = ("readonly database", "permission denied", "must be owner")
_NO_DATABASE = ("not a database", "malformed")
_NOBODY = ("authentication failed", "does not exist", "no pg_hba.conf entry", "no password supplied")


@contextmanager
def reading(engine: sa.Engine) -> Iterator[sa.Connection]:
    """Open a connection that reads; errors are translated as by `refusals`."""
    with refusals(engine), engine.connect() as connection:
        yield connection


@contextmanager
def writing(engine: sa.Engine) -> Iterator[sa.Connection]:
    """Open a transaction that writes, committed if the block ends without an error.

    Errors are translated as by `refusals`.
    """
    with refusals(engine), engine.connect().execution_options(**WRITES) as connection, connection.begin():
        yield connection


def _refusal(error: exc.DBAPIError, place: str) -> StoreError:
    """Return the error for a message of the database; SQLite has no classes for its errors."""
    words = str(error.orig)
    first = _first_line(error.orig)
    if any(mark in words for mark in _FULL):
        return StoreFull(
            f"has no room left ({first}).",
            do="Make room on its disk, then ask again; nothing was kept.",
            file=place,
        )
    if any(mark in words for mark in _RIGHTS):
        return StoreError(
            f"refuses it ({first}).",
            do="Connect as a user with this right: 'truepose fleet migrate --roles' makes the roles.",
            file=place,
        )
    if any(mark in words for mark in _NO_DATABASE):
        return StoreError(
            f"is not a database, or is damaged ({first}).",
            do="Give another file, or the backup; documents are in the records of the cells still.",
            file=place,
        )
    if any(mark in words for mark in _NOBODY):
        return StoreError(
            f"refuses the connection ({first}).",
            do="Check user, password and name of the database.",
            file=place,
        )
    if isinstance(error, (exc.OperationalError, exc.InterfaceError, exc.InternalError)):
        return StoreGone(f"does not answer ({first}).", do=_LATER, file=place)
    return StoreError(
        f"refuses it ({first}).", do="Report it to the maintainers of this program.", file=place
    )


def _first_line(error: BaseException | None) -> str:
    lines = str(error).strip().splitlines()
    return lines[0] if lines else "no reason given"


def migrate(url: str, *, roles: bool = False) -> tuple[str, str]:
    """Migrate the tables of a store to this program's version, or create them.

    Returns the version before ("" for none) and after. All or nothing. With `roles`, the roles of a PostgreSQL are
    created as well; existing ones get their rights in any case.

    Raises
    ------
    StoreError
        The store cannot be migrated.
    StoreGone
        The store does not answer.
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
    """Migrate within the transaction of a connection, and return the versions before and after.

    Raises
    ------
    StoreError
        The store has a newer version, or is another program's.
    """
    if engine.dialect.name == "postgresql":
        connection.execute(sa.text("SELECT pg_advisory_xact_lock(:lock)"), {"lock": _LOCK})
    before = version(connection, engine)
    if before != newest():
        config = _config()
        config.attributes["connection"] = connection
        command.upgrade(config, "head")
    return before, newest()


def version(connection: sa.Connection, engine: sa.Engine) -> str:
    """Return the version of a store, "" for an empty database.

    Raises
    ------
    StoreError
        The store has a newer version, or is another program's.
    """
    names = set(sa.inspect(connection).get_table_names())
    if _VERSIONS not in names:
        if names:
            raise StoreError(
                f"holds tables of something else ('{min(names)}').",
                do="Give a separate file or database.",
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
    """Return the version of this program's tables."""
    return _scripts().get_current_head() or ""


def _scripts() -> ScriptDirectory:
    return ScriptDirectory.from_config(_config())


def _config() -> Config:
    config = Config()
    config.set_main_option("script_location", str(_SCRIPTS).replace("%", "%%"))
    config.set_main_option("path_separator", "os")
    return config


def give_rights(connection: sa.Connection, engine: sa.Engine, *, make: bool) -> None:
    """Give the roles their rights in this database; with `make`, create missing ones.

    Raises
    ------
    StoreError
        Roles were requested for an SQLite file.
    """
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
