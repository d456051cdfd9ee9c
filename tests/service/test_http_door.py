"""The door of the server, which limits its connections.

These would catch: connections that send nothing and keep a stop from being received, and a known client that loses its
place to an unknown one. They would also catch a log that fills the disk.
"""

from __future__ import annotations

import asyncio
import logging
import socket
import subprocess
import sys
from contextlib import ExitStack, suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast
from urllib.parse import urlsplit

import pytest
import uvicorn
from hypothesis import given
from hypothesis import strategies as st
from starlette.types import Receive, Scope, Send

from service.cli import main
from service.http import server
from service.http.access.roles import Tokens
from service.http.server import HEADER_S, STREAMS, Connection, Door
from tests.service.test_http_support import ROOT, TOKEN, served

EXPORT = ROOT / "tests" / "certified" / "irb120_exact.csv"

TOKENS = Tokens(TOKEN, "only-looks-at-the-tests")
HALF = b"GET /api/v1/health HTTP/1.1\r\nHost: 127.0.0.1\r\n"
# Answers that are begun and never read: of files of the page, which need no token
UNREAD = b"GET /openapi.json HTTP/1.1\r\nHost: 127.0.0.1\r\n\r\n" * 8


def guest(*, known: bool = False, asked: bool = False, streams: bool = False) -> Any:
    """Return a connection at the door that records whether it was closed."""
    made = SimpleNamespace(known=known, asked=asked, streams=streams, since_s=0.0, gone=False)
    made.transport = SimpleNamespace(abort=lambda: setattr(made, "gone", True))
    # as objects, not by what they hold
    return type("Guest", (), {"__getattr__": lambda self, name: getattr(made, name), "made": made})()


class Watch:
    """Clock that only a test advances."""

    def __init__(self) -> None:
        self.now_s = 0.0

    def __call__(self) -> float:
        return self.now_s


def entered(door: Door, *guests: Any) -> None:
    for each in guests:
        door.enter(cast("Connection", each))


def test_who_sends_no_header_goes_after_seconds_and_who_waits_for_an_answer_stays() -> None:
    watch = Watch()
    door = Door(10, watch, TOKENS)
    silent, waiting, slow = guest(), guest(known=True, asked=True), guest(asked=True)
    entered(door, silent, waiting, slow)
    watch.now_s = HEADER_S - 0.1
    door.sweep()
    assert not silent.gone
    watch.now_s = HEADER_S + 0.1
    door.sweep()
    assert (silent.gone, waiting.gone, slow.gone) == (True, False, False)
    watch.now_s = server.ANSWER_S + 0.1
    door.sweep()
    assert (waiting.gone, slow.gone) == (False, True)


@given(st.lists(st.sampled_from(["stranger", "stream", "known"]), min_size=3, max_size=30))
def test_the_newest_is_let_in_and_strangers_go_first(kinds: list[str]) -> None:
    door = Door(len(kinds), Watch(), TOKENS)
    made = [
        guest(known=kind != "stranger", asked=kind != "known", streams=kind == "stream") for kind in kinds
    ]
    entered(door, *made)
    assert not any(each.gone for each in made)
    new = guest()
    entered(door, new)
    gone = [kind for each, kind in zip(made, kinds, strict=True) if each.gone]
    assert not new.gone
    assert gone == [min(kinds, key=["stranger", "stream", "known"].index)]
    first = kinds.index(gone[0])
    assert made[first].gone, "the oldest of its kind"


def test_streams_have_a_cap_of_their_own() -> None:
    door = Door(10 * STREAMS, Watch(), TOKENS)
    streams = [guest(known=True, asked=True, streams=True) for _ in range(STREAMS + 1)]
    entered(door, guest(known=True, asked=True), *streams)
    door.count_streams()
    assert [each.gone for each in streams] == [True, *[False] * STREAMS]


def test_many_closed_connections_are_one_line(caplog: pytest.LogCaptureFixture) -> None:
    door = Door(3, Watch(), TOKENS)
    entered(door, *(guest() for _ in range(500)))
    assert len(caplog.records) == 1


class Wire:
    """Transport of a connection.

    The test gives the received bytes to the connection, and the sent bytes are discarded.
    """

    def __init__(self) -> None:
        self.closing = False

    def get_extra_info(self, name: str) -> None:
        return None

    def is_closing(self) -> bool:
        return self.closing

    def close(self) -> None:
        self.closing = True

    def _nothing(self, *_: object) -> None:
        pass

    write = pause_reading = resume_reading = _nothing


def connections(count: int, app: Any) -> list[Connection]:
    """Connections to one application, within a loop."""
    config = uvicorn.Config(app, lifespan="off", ws="none", log_config=None)
    config.load()
    state = uvicorn.Server(config).server_state
    # `Server` makes them so
    make = partial(Connection, Door(1000, Watch(), TOKENS), config=config, server_state=state, app_state={})
    made = [make() for _ in range(count)]
    for each in made:
        each.connection_made(cast("asyncio.Transport", Wire()))
    return made


def request(path: str, more: str = "", token: str = "wrong") -> bytes:
    return f"POST {path} HTTP/1.1\r\nHost: me\r\nAuthorization: Bearer {token}\r\n{more}\r\n".encode()


def test_who_has_a_token_is_read_before_the_endless_pieces_of_strangers() -> None:
    read: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        while (await receive()).get("more_body"):
            pass
        read.append(scope["path"])

    async def scene() -> None:
        *strangers, mine = connections(9, app)
        for each in strangers:
            each.data_received(request("/stranger", "Transfer-Encoding: chunked\r\n"))
            each.data_received(b"1\r\nx\r\n" * 20_000 + b"0\r\n\r\n")
        mine.data_received(request("/stop", token=TOKEN))
        while len(read) < 9:
            await asyncio.sleep(0)

    asyncio.run(scene())
    assert read[0] == "/stop"


def test_the_next_request_of_a_connection_waits_for_no_stranger() -> None:
    """The next request waited 0.2 s behind a thousand half headers.

    This happened if nothing had followed the first request of the connection.
    """
    read: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        read.append(scope["path"])
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"0")]})
        await send({"type": "http.response.body"})

    async def scene() -> list[str]:
        *strangers, mine = connections(9, app)
        for each in strangers:
            each.data_received(request("/stranger") + b"x" * 100_000)
        for path in ("/status", "/stop"):
            mine.data_received(request(path, token=TOKEN))
            for _ in range(3):
                await asyncio.sleep(0)
        return [path for path in read if path != "/stranger"]

    assert asyncio.run(scene()) == ["/status", "/stop"]


@pytest.mark.parametrize("token", ["wrong", TOKEN])
def test_of_many_requests_that_came_at_once_one_is_begun_in_a_turn(token: str) -> None:
    """Twenty unknown clients, or twenty pipelined requests, must not make one long turn."""
    asked = 0

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        nonlocal asked
        asked += 1
        await send({"type": "http.response.start", "status": 200, "headers": [(b"content-length", b"0")]})
        await send({"type": "http.response.body"})

    async def scene() -> int:
        most = 0
        for each in connections(20, app):
            each.data_received(request("/health", token=token) * 5)
        for _ in range(3):  # the first of each who is known is read at once
            await asyncio.sleep(0)
        while asked < 100:
            before = asked
            await asyncio.sleep(0)
            most = max(most, asked - before)
        return most

    assert asyncio.run(scene()) <= 5


@pytest.mark.parametrize(("method", "ended"), [("GET", ["cancelled"]), ("POST", [])])
def test_who_asks_and_goes_leaves_nothing_that_waits(method: str, ended: list[str]) -> None:
    """A thousand such clients, each with a waiting task, would fill the memory.

    An order is carried out nevertheless.
    """
    told: list[str] = []

    async def app(scope: Scope, receive: Receive, send: Send) -> None:
        try:
            await asyncio.Event().wait()
        except asyncio.CancelledError:
            told.append("cancelled")
            raise

    async def scene() -> list[str]:
        [mine] = connections(1, app)
        mine.data_received(request("/runs", token=TOKEN).replace(b"POST", method.encode()))
        await asyncio.sleep(0)
        mine.transport.close()
        mine.connection_lost(None)
        for _ in range(3):
            await asyncio.sleep(0)
        return list(told)

    assert asyncio.run(scene()) == ended


def test_a_warning_that_comes_again_and_again_is_told_once_in_a_while() -> None:
    watch = Watch()
    once = server._Once(watch)

    def passes(level: int, text: str) -> bool:
        return bool(once.filter(logging.LogRecord("uvicorn.error", level, "", 0, text, None, None)))

    assert [passes(logging.WARNING, "Invalid HTTP request.") for _ in range(3)] == [True, False, False]
    assert passes(logging.WARNING, "Another.")
    assert all(passes(logging.ERROR, "A fault.") for _ in range(2))
    watch.now_s = 60.0
    assert passes(logging.WARNING, "Invalid HTTP request.")


@pytest.mark.parametrize(
    "sent", [b"", HALF, UNREAD], ids=["nothing", "half a header", "answers that are not read"]
)
def test_a_service_with_few_files_answers_beside_hundreds_of_connections(sent: bytes, tmp_path: Path) -> None:
    with served(tmp_path / "record", files=160) as service, ExitStack() as held:
        place = urlsplit(service.url)
        for _ in range(300):
            each = held.enter_context(socket.create_connection((str(place.hostname), int(place.port or 0))))
            with suppress(OSError):  # it may be closed already
                each.sendall(sent)
        for _ in range(3):  # on a connection of its own, each
            with socket.create_connection((str(place.hostname), int(place.port or 0)), timeout=60.0) as mine:
                asks = f"GET /api/v1/runs HTTP/1.1\r\nHost: {place.netloc}\r\nConnection: close\r\n"
                mine.sendall(f"{asks}Authorization: Bearer {TOKEN}\r\n\r\n".encode())
                assert mine.recv(100).startswith(b"HTTP/1.1 200")
    log = (tmp_path / "record.log").read_text("utf-8")
    assert "Traceback" not in log
    assert len(log) < 5_000


def test_what_lies_in_the_folder_of_the_user_is_not_executed(tmp_path: Path) -> None:
    """Modules with our names are next to the user's files; the workers are separate processes."""
    for name in ("fleet", "mocks", "calib", "acquisition", "drivers", "service", "truepose"):
        (tmp_path / f"{name}.py").write_text("raise SystemExit('executed')\n", "utf-8")
    with served(tmp_path / "record", folder=tmp_path) as service:
        block = {"set": "calibration", "count": 20, "select": "random"}
        order = {"campaign": {"format": "truepose-campaign/1", "block": [block]}}
        answer = service.client.post("/runs", json=order)
        assert answer.status_code != 500, answer.text
        files = {"csv": EXPORT.read_bytes(), "toml": EXPORT.with_suffix(".toml").read_bytes()}
        dataset = service.client.post("/datasets", files=files).json()["id"]
        job = service.client.post("/identifications", json={"dataset_id": dataset}).json()["id"]
        assert service.until(f"/identifications/{job}", "succeeded", "failed")["state"] == "succeeded"


def test_a_folder_is_served_once(tmp_path: Path) -> None:
    record = tmp_path / "record"
    (tmp_path / "link").symlink_to(tmp_path)
    with served(record) as service:
        command = [sys.executable, "-m", "service.cli", "serve", "--record"]
        for lock in ("there", "deleted"):
            if lock == "deleted":
                (record / "service.lock").unlink()
            done = subprocess.run(
                [*command, str(tmp_path / "link" / "record")],
                capture_output=True,
                text=True,
                check=False,
                cwd=ROOT,
                timeout=120.0,
            )
            assert done.returncode == 2
            assert service.url in done.stderr
            assert f"process {service.process.pid}" in done.stderr
            assert (record / "tokens").exists()
    with served(record):  # whoever ends gives it back
        pass
    assert not (record / "service.txt").exists()


@pytest.mark.parametrize("name", ["tokens", "service.txt"])
@pytest.mark.parametrize("kind", ["text", "folder", "link"])
def test_files_of_the_user_in_the_folder_are_not_replaced(name: str, kind: str, tmp_path: Path) -> None:
    mine, kept = tmp_path / name, tmp_path / "kept"
    kept.write_text("mine\n", "utf-8")
    if kind == "text":
        mine.write_text("mine\n", "utf-8")
    elif kind == "folder":
        mine.mkdir()
    else:
        mine.symlink_to(kept)
    assert main(["serve", "--record", str(tmp_path)]) == 2
    assert kept.read_text("utf-8") == "mine\n"
    assert mine.is_dir() if kind == "folder" else mine.read_text("utf-8") == "mine\n"


def test_a_service_that_is_refused_makes_no_folder(tmp_path: Path) -> None:
    cell = tmp_path / "cell.toml"
    cell.write_text("format = 'something else'\n", "utf-8")
    assert main(["serve", "--cell", str(cell), "--record", str(tmp_path / "record")]) != 0
    assert list(tmp_path.iterdir()) == [cell]
