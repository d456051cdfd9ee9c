"""A stop has threads of its own: it is heard while every thread that may wait does."""

from __future__ import annotations

import threading
from pathlib import Path

import anyio

from service.http.roles import Tokens
from service.http.settings import Settings
from service.http.state import WAITERS, Service
from tests.drivers.waiting import PATIENCE_S


def test_a_stop_is_heard_while_every_thread_that_may_wait_does(tmp_path: Path) -> None:
    go, waiting = threading.Event(), threading.Semaphore(0)

    def wait() -> None:
        waiting.release()
        go.wait(2 * PATIENCE_S)

    async def stop_among_waiters() -> str:
        here = Service(Settings(record=tmp_path, tokens=Tokens("o", "v")))
        try:
            async with anyio.create_task_group() as tasks:
                for _ in range(WAITERS):
                    tasks.start_soon(here.waiting, wait)
                try:
                    for _ in range(WAITERS):
                        while not waiting.acquire(blocking=False):
                            await anyio.sleep(0.001)
                    with anyio.fail_after(PATIENCE_S):
                        return await here.urgent(lambda: "stopped")
                finally:
                    go.set()
        finally:
            here.close()

    assert anyio.run(stop_among_waiters) == "stopped"
