"""Both databases for the tests of this folder.

They are an SQLite file, and a PostgreSQL that is started once per session.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest

from fleet.store import FleetStore, migrate
from tests.fleet.postgres import Absent, Cluster

LARGEST_FILE = 20_000_000
"""Bytes: the disk of the server is full for what is larger, its journal has files of 16 MB."""


@pytest.fixture(scope="session")
def postgres() -> Iterator[Cluster]:
    """Start a PostgreSQL; skip the tests with the reason if none is available."""
    try:
        cluster = Cluster(LARGEST_FILE)
    except Absent as error:
        pytest.skip(str(error))
    yield cluster
    cluster.end()


@pytest.fixture(scope="session")
def template(postgres: Cluster) -> str:
    """Name of a database with the tables of a store, to be copied."""
    url = postgres.database()
    migrate(url)
    return urlsplit(url).path[1:]


@pytest.fixture(params=["sqlite", "postgresql"])
def url(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """The address of an empty store, once of each kind."""
    if request.param == "sqlite":
        return f"sqlite:///{tmp_path}/store.sqlite3"
    cluster: Cluster = request.getfixturevalue("postgres")
    return cluster.database(request.getfixturevalue("template"))


@pytest.fixture
def store(url: str) -> Iterator[FleetStore]:
    """An empty store, once of each kind."""
    with FleetStore.open(url) as opened:
        yield opened
