"""Versions of the tables (created, migrated, refused), and the permissions of a role."""

from __future__ import annotations

import sqlite3
import sys
from collections.abc import Callable
from pathlib import Path

import psycopg
import pytest
import sqlalchemy as sa
from alembic.autogenerate import compare_metadata
from alembic.runtime.migration import MigrationContext

from fleet.errors import StoreError
from fleet.store import READER, WRITER, FleetJob, FleetStore, migrate, tables
from fleet.store.engine import engine_of, newest
from tests.fleet.documents import BEGAN, ROBOT, model
from tests.fleet.postgres import Cluster


def test_migrations_make_the_tables_that_the_program_has(url: str) -> None:
    FleetStore.open(url).close()
    engine = engine_of(url)
    with engine.connect() as connection:
        found = compare_metadata(MigrationContext.configure(connection), tables.METADATA)
    engine.dispose()
    assert found == []


def _set_version(url: str, version: str) -> None:
    engine = engine_of(url)
    with engine.begin() as connection:
        connection.execute(sa.text("UPDATE alembic_version SET version_num = :v"), {"v": version})
    engine.dispose()


def test_a_store_of_a_newer_program_is_refused_and_left_alone(url: str) -> None:
    with FleetStore.open(url) as store:
        store.add(model({"d1": 1.0}))
    _set_version(url, "9999")
    for ask in (FleetStore.open, migrate):
        with pytest.raises(StoreError, match=r"newer version.*'9999'.*Update TruePose"):
            ask(url)
    _set_version(url, newest())
    with FleetStore.open(url) as store:
        assert len(store.documents()) == 1


def test_migrating_twice_changes_nothing(url: str) -> None:
    assert migrate(url) in (("", newest()), (newest(), newest()))
    assert migrate(url) == (newest(), newest())


def test_a_file_is_carried_over_when_it_is_opened_a_server_only_on_demand(
    tmp_path: Path, postgres: Cluster
) -> None:
    with FleetStore.open(f"sqlite:///{tmp_path}/new.sqlite3") as store:
        assert store.documents() == []
    empty = postgres.database()
    with pytest.raises(StoreError, match=r"no tables yet.*truepose fleet migrate"):
        FleetStore.open(empty)
    assert migrate(empty) == ("", newest())
    FleetStore.open(empty).close()


def test_a_migration_that_fails_leaves_nothing(
    url: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Power that is cut in the middle: the tables are made in one transaction."""
    fresh = f"sqlite:///{tmp_path}/fresh.sqlite3" if url.startswith("sqlite") else url
    engine = engine_of(fresh)
    with engine.begin() as connection:
        for name in [*reversed([t.name for t in tables.METADATA.sorted_tables]), "alembic_version"]:
            connection.execute(sa.text(f"DROP TABLE IF EXISTS {name}"))
    monkeypatch.setattr("alembic.operations.Operations.create_index", _fails)
    with pytest.raises(InterruptedError):
        migrate(fresh)
    with engine.connect() as connection:
        assert sa.inspect(connection).get_table_names() == []
    engine.dispose()
    monkeypatch.undo()
    assert migrate(fresh) == ("", newest())


def _fails(*_: object, **__: object) -> None:
    raise InterruptedError


def _with_tables_of_another(path: Path) -> None:
    connection = sqlite3.connect(path)
    connection.execute("CREATE TABLE orders (id INTEGER)")
    connection.close()


@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (_with_tables_of_another, r"'orders'.*separate"),
        (
            lambda path: path.write_bytes(b"no database at all, but long enough to have a header " * 20),
            "not a database",
        ),
        (lambda path: path.mkdir(), "unable to open"),
    ],
)
def test_a_file_of_something_else_is_refused(
    tmp_path: Path, spoil: Callable[[Path], object], said: str
) -> None:
    path = tmp_path / "store.sqlite3"
    spoil(path)
    with pytest.raises(StoreError, match=said) as refused:
        FleetStore.open(f"sqlite:///{path}")
    assert str(path) in str(refused.value)


@pytest.mark.parametrize(
    ("address", "said"),
    [
        ("nonsense", "not the address"),
        ("mysql://a@b/c", "address of mysql"),
        ("sqlite://", "names no file"),
        ("sqlite:////nowhere/at/all/store.sqlite3", "folder does not exist"),
    ],
)
def test_an_address_that_is_none_is_refused(address: str, said: str) -> None:
    with pytest.raises(StoreError, match=said):
        FleetStore.open(address)


def test_a_cell_without_the_driver_is_told_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "psycopg", None)
    with pytest.raises(StoreError, match=r"psycopg is not installed.*truepose\[fleet\]"):
        FleetStore.open("postgresql://anna@db/plant")


def test_a_password_is_never_told(tmp_path: Path) -> None:
    with pytest.raises(StoreError) as refused:
        FleetStore.open(f"postgresql://anna:secret@/plant?host={tmp_path}")
    assert "secret" not in str(refused.value)
    assert "anna" in str(refused.value)


@pytest.fixture
def shared(postgres: Cluster) -> Callable[[str], str]:
    """A store with roles; its address as a user who has one of them, or none."""
    url = postgres.database()
    migrate(url, roles=True)

    def as_member_of(role: str) -> str:
        user = f"user_of_{role}"
        known = psycopg.connect(url, autocommit=True)
        with known:
            if not known.execute("SELECT 1 FROM pg_roles WHERE rolname = %s", (user,)).fetchone():
                known.execute(f"CREATE ROLE {user} LOGIN {f'IN ROLE {role}' if role else ''}".encode())
        return url.replace("postgresql://postgres@", f"postgresql://{user}@")

    return as_member_of


def test_a_writer_puts_in_and_changes_nothing(shared: Callable[[str], str]) -> None:
    url, given = shared(WRITER), model({"d1": 1.0})
    with FleetStore.open(url) as store:
        assert store.add(given).state == "new"
        assert store.add(model({"d1": 2.0}, identity="other")).state == "new"
        job = FleetJob("diagnose", given.hash, "0.1.0")
        assert store.work.claim([job], "w", BEGAN, 60.0) == [job]
        assert store.work.claim([job], "w", BEGAN, 120.0) == [job]
        assert store.work.finish(job, "w", b"result", BEGAN, 1.0)
    with psycopg.connect(url, autocommit=True) as connection:
        for table in ("document", "content", "parameter", "verdict", "result", "robot"):
            for statement in (f"DELETE FROM {table}", f"TRUNCATE {table}", f"DROP TABLE {table}"):
                with pytest.raises(psycopg.errors.InsufficientPrivilege):
                    connection.execute(statement.encode())
        with pytest.raises(psycopg.errors.InsufficientPrivilege):
            connection.execute("UPDATE content SET bytes = 'x'")


def test_a_reader_only_reads(shared: Callable[[str], str]) -> None:
    with FleetStore.open(shared(WRITER)) as store:
        store.add(model({"d1": 1.0}))
    with FleetStore.open(shared(READER)) as store:
        assert len(store.trend(ROBOT)) == 1
        with pytest.raises(StoreError, match=r"permission denied.*right"):
            store.add(model({"d1": 2.0}, day=1))
        assert len(store.documents()) == 1


def test_whoever_has_no_role_sees_nothing(shared: Callable[[str], str]) -> None:
    with pytest.raises(StoreError, match="permission denied"):
        FleetStore.open(shared(""))


def test_a_file_has_no_roles(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="no roles"):
        migrate(f"sqlite:///{tmp_path}/store.sqlite3", roles=True)
