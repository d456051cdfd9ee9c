"""A database that is away, full, locked or killed in the middle.

It raises our refusal, keeps nothing by half, and work continues later.
"""

from __future__ import annotations

import json
import pickle
import secrets
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import psutil
import psycopg
import pytest
import sqlalchemy as sa
from sqlalchemy import event, exc

from fleet.errors import StoreError, StoreGone
from fleet.store import Document, FleetStore, migrate
from fleet.store import engine as engines
from fleet.store.engine import writing
from service import exit_codes, refusals
from tests.fleet.documents import BEGAN, ROBOT, model, watch
from tests.fleet.postgres import Cluster

ROOT = Path(__file__).parents[2]
LARGE = (
    24_000_000  # bytes; beyond the 16 MB of a file of PostgreSQL's journal, which must not be what is full
)

PATIENT_S = 4  # also what is answered is answered within it, on a machine that does other things


@pytest.fixture
def server(postgres: Cluster, template: str) -> str:
    """The address of an empty store on the server alone."""
    return postgres.database(template)


def test_a_server_that_is_away_for_an_hour(postgres: Cluster, server: str) -> None:
    with FleetStore.open(server) as store:
        store.add(model({"d1": 1.0}))
        postgres.stop()
        try:
            asked: list[Callable[[], object]] = [
                lambda: store.add(model({"d1": 2.0}, day=1)),
                lambda: store.trend(ROBOT),
                lambda: store.robots(),
                lambda: store.work.results(),
                lambda: FleetStore.open(server),
                lambda: migrate(server),
            ]
            for ask in asked:
                with pytest.raises(StoreGone) as gone:
                    ask()
                assert str(postgres.folder) in str(gone.value)  # the place
                assert "ask again" in gone.value.do
                assert refusals.exit_code(gone.value) == exit_codes.NOT_AVAILABLE
        finally:
            postgres.start()
        assert store.add(model({"d1": 2.0}, day=1)).state == "new"  # the same store, with nothing done to it
        assert len(store.documents()) == 2


def test_a_server_that_began_anew_between_two_questions(postgres: Cluster, server: str) -> None:
    with FleetStore.open(server) as store:
        store.add(model({"d1": 1.0}))
        postgres.stop()
        postgres.start()
        assert len(store.documents()) == 1
        postgres.stop()
        postgres.start()
        assert store.add(model({"d1": 2.0}, day=1)).state == "new"


def _at(store: FleetStore, table: str, act: Callable[[], object]) -> None:
    """Act once, just before rows of a table are put in."""
    left = [act]

    def before(_connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
        if f"INSERT INTO {table}" in statement and left:
            left.pop()()

    event.listen(store._engine, "before_cursor_execute", before)


@pytest.mark.parametrize("table", ["document", "content", "parameter", "verdict", "cause"])
def test_a_server_that_goes_in_the_middle_has_kept_nothing(
    postgres: Cluster, server: str, table: str
) -> None:
    with FleetStore.open(server) as store:
        _at(store, table, lambda: (postgres.stop(), postgres.start()))
        documents = [model({"d1": 1.0}), watch(day=1)]
        with pytest.raises(StoreGone):
            store.add_all(documents)
        assert store.documents() == []
        assert store.trend(ROBOT) == []
        assert [each.state for each in store.add_all(documents)] == ["new", "new"]
        assert len(store.verdicts()) == 1


def test_of_two_that_wait_for_each_other_one_begins_anew(server: str) -> None:
    """The server ends one of them with the error that a server raises in this test."""
    ended = "DO $$ BEGIN RAISE EXCEPTION 'deadlock detected' USING ERRCODE = '40P01'; END $$"
    with FleetStore.open(server) as store:
        left = [ended]

        def before(connection: Any, _cursor: Any, statement: str, *_: Any) -> None:
            if "INSERT INTO document" in statement and left:
                connection.exec_driver_sql(left.pop())

        event.listen(store._engine, "before_cursor_execute", before)
        assert [each.state for each in store.add_all([model({"d1": 1.0}), watch(day=1)])] == ["new", "new"]
        assert not left
        assert len(store.documents()) == 2


_KILLED = """
import os, pickle, signal, sys
from tests.fleet.test_gone import _at
from fleet.store import FleetStore
url, documents = pickle.load(sys.stdin.buffer)
with FleetStore.open(url) as store:
    _at(store, "verdict", lambda: os.kill(os.getpid(), signal.SIGKILL))
    store.add_all(documents)
"""


def test_a_program_that_is_killed_has_kept_nothing(url: str) -> None:
    documents = [model({"d1": 1.0}), watch(day=1)]
    done = subprocess.run(
        [sys.executable, "-c", _KILLED], input=pickle.dumps((url, documents)), cwd=ROOT, check=False
    )
    assert done.returncode == -signal.SIGKILL
    with FleetStore.open(url) as store:
        assert store.documents() == []
        assert [each.state for each in store.add_all(documents)] == ["new", "new"]


def _large() -> Document:
    content = json.dumps({"format": "truepose-run/1", "noise": secrets.token_hex(LARGE // 2)})
    return Document("campaign", ROBOT, "cell-1", "large", BEGAN, content.encode())


@contextmanager
def _full(store: FleetStore) -> Iterator[None]:
    """Make the store refuse large contents.

    The PostgreSQL does so from the start (`conftest.LARGEST_FILE`).
    """
    if store._engine.dialect.name == "postgresql":
        yield
        return
    with store._engine.connect() as connection:  # the one that the pool keeps
        pages = connection.exec_driver_sql("PRAGMA page_count").scalar_one()
        connection.exec_driver_sql(f"PRAGMA max_page_count = {pages + 10}")
    yield
    with store._engine.connect() as connection:
        connection.exec_driver_sql("PRAGMA max_page_count = 1000000000")


def test_a_full_disk(store: FleetStore) -> None:
    store.add(model({"d1": 1.0}))
    with _full(store):
        with pytest.raises(StoreGone, match="no room left") as full:
            store.add_all([model({"d1": 2.0}, day=1), _large()])
        assert "Make room" in full.value.do
        assert len(store.documents()) == 1
        assert len(store.trend(ROBOT)) == 1
    assert store.add(model({"d1": 2.0}, day=1)).state == "new"


def test_a_file_that_another_program_holds(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(engines, "BUSY_S", 0.05)
    with FleetStore.open(f"sqlite:///{tmp_path}/store.sqlite3") as store:
        other = sqlite3.connect(tmp_path / "store.sqlite3", isolation_level=None)
        other.execute("BEGIN IMMEDIATE")
        assert store.documents() == []  # whoever reads does not wait
        with pytest.raises(StoreGone, match="locked"):
            store.add(model({"d1": 1.0}))
        other.execute("COMMIT")
        other.close()
        assert store.add(model({"d1": 1.0})).state == "new"


@pytest.mark.parametrize(("old", "new"), [("postgres@", "nobody_known@"), ("?host", "_of_nobody?host")])
def test_an_address_that_lets_nobody_in_is_not_asked_again(server: str, old: str, new: str) -> None:
    with pytest.raises(StoreError, match="does not exist") as refused:
        FleetStore.open(server.replace(old, new))
    assert not isinstance(refused.value, StoreGone)
    assert refusals.exit_code(refused.value) == exit_codes.USAGE


def test_a_damaged_file_is_refused_in_a_sentence(tmp_path: Path) -> None:
    path = tmp_path / "store.sqlite3"
    with FleetStore.open(f"sqlite:///{path}") as store:
        store.add_all([model({f"p{i}": 1.0 for i in range(200)}, day=day) for day in range(20)])
    content = path.read_bytes()
    path.write_bytes(content[:8192] + bytes(len(content) - 8192))
    with (
        pytest.raises(StoreError, match=r"damaged.*records of the cells"),
        FleetStore.open(f"sqlite:///{path}") as store,
    ):
        store.trend(ROBOT)


def test_a_defect_is_not_hidden(store: FleetStore) -> None:
    """Only what the database says becomes a refusal."""
    with pytest.raises(exc.InvalidRequestError), engines.refusals(store._engine):
        raise exc.InvalidRequestError("a defect of ours")


def test_a_file_that_another_program_is_making_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "store.sqlite3"
    other = sqlite3.connect(path, isolation_level=None)
    other.execute("BEGIN IMMEDIATE")
    other.execute("CREATE TABLE theirs (x)")
    waited: list[float] = []

    def wait(seconds: float) -> None:
        waited.append(seconds)
        other.execute("COMMIT")

    monkeypatch.setattr("fleet.store.engine.time.sleep", wait)
    with engines.engine_of(f"sqlite:///{path}").connect() as connection:
        assert connection.exec_driver_sql("PRAGMA journal_mode").scalar() == "wal"
    assert len(waited) == 1
    other.close()


@contextmanager
def hanging(postgres: Cluster) -> Iterator[None]:
    """Stop the processes of a server, like a disk that no longer answers.

    Connections stay open and are silent.
    """
    leader = psutil.Process(int((postgres.folder / "data" / "postmaster.pid").read_text("utf-8").split()[0]))
    family = [leader, *leader.children(recursive=True)]
    for each in family:
        each.suspend()
    try:
        yield
    finally:
        for each in family:
            each.resume()


def test_a_server_that_hangs_is_given_up(
    postgres: Cluster, server: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("fleet.store.postgres.LATER_S", 0.1)
    with FleetStore.open(f"{server}&answer_timeout={PATIENT_S}&connect_timeout={PATIENT_S}") as store:
        store.add(model({"d1": 1.0}))

        def ask() -> None:
            with writing(store._engine) as connection:
                connection.execute(sa.text("SELECT 1"))
                with hanging(postgres):  # in the middle of a transaction
                    connection.execute(sa.text("SELECT 2"))

        with pytest.raises(StoreGone, match=rf"nothing came within {PATIENT_S}\.1 s"):
            ask()
        assert store.add(model({"d1": 2.0}, day=1)).state == "new"  # the same store, when the server goes on
        with hanging(postgres), pytest.raises(StoreGone, match="connection timeout expired"):
            store.robots()
        assert len(store.documents()) == 2


def test_a_question_that_waits_for_a_lock_is_ended_by_the_server(server: str) -> None:
    with FleetStore.open(f"{server}&answer_timeout={PATIENT_S}") as store, psycopg.connect(server) as other:
        other.execute("LOCK TABLE robot IN ACCESS EXCLUSIVE MODE")
        with pytest.raises(StoreGone, match="statement timeout"):
            store.robots()
        other.rollback()
        assert store.robots() == []


def test_a_time_that_is_none_is_refused_by_its_name(server: str) -> None:
    for key in ("answer_timeout", "connect_timeout"):
        with pytest.raises(StoreError, match="whole seconds") as refused:
            FleetStore.open(f"{server}&{key}=soon")
        assert refused.value.key == key
    with FleetStore.open(f"{server}&answer_timeout=0") as store:
        assert store.robots() == []
