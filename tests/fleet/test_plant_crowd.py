"""Uploads that do not end, and more of them than the server has room for."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from fleet.store import FleetStore
from service.plant import FleetServerSettings, Senders, create_plant, routes
from service.plant.routes import SHARE, UPLOADS
from tests.drivers.waiting import PATIENCE_S
from tests.fleet import documents
from tests.fleet.test_plant import TOKENS, uploaded

SENT = documents.model({"d1": 0.25})


async def upload(
    app: Any, receive: Callable[[], Awaitable[Any]], cell: str = SENT.cell
) -> tuple[int, dict[str, Any]]:
    """Status and document of the answer to an upload of a cell, whose body comes by `receive`."""
    told = await uploaded(app, replace(SENT, cell=cell), receive)
    return told[0]["status"], json.loads(told[1]["body"])


def test_whoever_falls_silent_in_an_upload_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "PIECE_S", 0.05)

    async def silent() -> tuple[int, dict[str, Any]]:
        pieces = [{"type": "http.request", "body": SENT.content[:20], "more_body": True}]

        async def receive() -> Any:
            return pieces.pop() if pieces else await asyncio.Event().wait()

        async with asyncio.timeout(PATIENCE_S):
            return await upload(create_plant(store, FleetServerSettings(Senders(TOKENS))), receive)

    with FleetStore.open(f"sqlite:///{tmp_path}/plant.sqlite3") as store:
        status, told = asyncio.run(silent())
        assert (status, told["what_to_do"]) == (408, "Send it again.")
        assert store.documents() == []


def test_who_comes_when_all_places_are_taken_is_told_when_to_come_again(tmp_path: Path) -> None:
    async def crowd() -> list[int]:
        app = create_plant(store, FleetServerSettings(Senders(TOKENS)))
        here, on = asyncio.Semaphore(0), asyncio.Event()

        async def receive() -> Any:
            here.release()
            await on.wait()
            return {"type": "http.request", "body": SENT.content, "more_body": False}

        uploads = [asyncio.create_task(upload(app, receive, f"hall {n}")) for n in range(UPLOADS)]
        for _ in uploads:
            await here.acquire()
        try:
            async with asyncio.timeout(PATIENCE_S):
                status, told = await upload(app, receive, "hall 99")
        finally:
            on.set()
        assert told["operator_text"] == "Too many documents are being sent."
        return [status, *(status for status, _ in await asyncio.gather(*uploads))]

    with FleetStore.open(f"sqlite:///{tmp_path}/plant.sqlite3") as store:
        late, *others = asyncio.run(crowd())
        assert late == 503
        assert sorted(others) == [*[200] * (UPLOADS - 1), 201]  # the same document: kept once


def test_a_cell_that_sends_slowly_and_often_leaves_places_to_the_others(tmp_path: Path) -> None:
    async def crowd() -> list[int]:
        app = create_plant(store, FleetServerSettings(Senders(TOKENS)))
        here, on = asyncio.Semaphore(0), asyncio.Event()

        async def slow() -> Any:
            here.release()
            await on.wait()
            return {"type": "http.disconnect"}

        async def whole() -> Any:
            return {"type": "http.request", "body": SENT.content, "more_body": False}

        async with asyncio.timeout(PATIENCE_S):
            uploads = [asyncio.create_task(uploaded(app, SENT, slow)) for _ in range(SHARE)]
            for _ in uploads:
                await here.acquire()
            more = [(await upload(app, whole))[0] for _ in range(UPLOADS - SHARE)]
            other, _ = await upload(app, whole, "hall 99")
            on.set()
            await asyncio.gather(*uploads)
            after, _ = await upload(app, whole)
        return [*more, other, after]

    with FleetStore.open(f"sqlite:///{tmp_path}/plant.sqlite3") as store:
        *more, other, after = asyncio.run(crowd())
        assert set(more) == {503}
        assert (other, after) == (201, 200)  # the same document, which was kept once


def test_an_upload_that_trickles_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "UPLOAD_S", 0.05)

    async def trickling() -> tuple[int, dict[str, Any]]:
        async def receive() -> Any:
            await asyncio.sleep(0)
            return {"type": "http.request", "body": b"x" * 1024, "more_body": True}

        async with asyncio.timeout(PATIENCE_S):
            return await upload(create_plant(store, FleetServerSettings(Senders(TOKENS))), receive)

    with FleetStore.open(f"sqlite:///{tmp_path}/plant.sqlite3") as store:
        assert asyncio.run(trickling())[0] == 408
        assert store.documents() == []
