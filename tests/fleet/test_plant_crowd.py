"""Uploads that do not end, and more of them than the server has room for."""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import pytest

from fleet.store import Store
from service.plant import Senders, Settings, create_plant, routes
from service.plant.app import UPLOADS
from tests.drivers.waiting import PATIENCE_S
from tests.fleet import documents
from tests.fleet.test_plant import TOKENS, uploaded

SENT = documents.model({"d1": 0.25})


async def upload(app: Any, receive: Callable[[], Awaitable[Any]]) -> tuple[int, dict[str, Any]]:
    """Status and document of the answer to an upload whose body comes by `receive`."""
    told = await uploaded(app, SENT, receive)
    return told[0]["status"], json.loads(told[1]["body"])


def test_whoever_falls_silent_in_an_upload_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(routes, "PIECE_S", 0.05)

    async def silent() -> tuple[int, dict[str, Any]]:
        pieces = [{"type": "http.request", "body": SENT.content[:20], "more_body": True}]

        async def receive() -> Any:
            return pieces.pop() if pieces else await asyncio.Event().wait()

        async with asyncio.timeout(PATIENCE_S):
            return await upload(create_plant(store, Settings(Senders(TOKENS))), receive)

    with Store.open(f"sqlite:///{tmp_path}/plant.sqlite3") as store:
        status, told = asyncio.run(silent())
        assert (status, told["what_to_do"]) == (408, "Send it again.")
        assert store.documents() == []


def test_who_comes_when_all_places_are_taken_is_told_when_to_come_again(tmp_path: Path) -> None:
    async def crowd() -> list[int]:
        app = create_plant(store, Settings(Senders(TOKENS)))
        here, on = asyncio.Semaphore(0), asyncio.Event()

        async def receive() -> Any:
            here.release()
            await on.wait()
            return {"type": "http.request", "body": SENT.content, "more_body": False}

        uploads = [asyncio.create_task(upload(app, receive)) for _ in range(UPLOADS)]
        for _ in uploads:
            await here.acquire()
        try:
            async with asyncio.timeout(PATIENCE_S):
                status, told = await upload(app, receive)
        finally:
            on.set()
        assert told["operator_text"] == "Too many documents are being sent."
        return [status, *(status for status, _ in await asyncio.gather(*uploads))]

    with Store.open(f"sqlite:///{tmp_path}/plant.sqlite3") as store:
        late, *others = asyncio.run(crowd())
        assert late == 503
        assert sorted(others) == [*[200] * (UPLOADS - 1), 201]  # the same document: kept once
