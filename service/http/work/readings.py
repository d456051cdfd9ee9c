"""Shared reading of documents: simultaneous requests for the same document read it once.

Documents come from SQLite and JSON files and cost milliseconds of the interpreter, which all threads share with
the one that stops the robot. So a few threads read, and two hundred clients that watch one run cost little more
than one.
"""

from __future__ import annotations

import asyncio
from collections.abc import Callable
from typing import Any, TypeVar

import anyio
import anyio.to_thread

_T = TypeVar("_T")


class DocumentCache:
    """Shared readings of documents, made and used within the event loop.

    `threads` is the number of simultaneous readings.
    """

    def __init__(self, threads: int) -> None:
        self._threads = anyio.CapacityLimiter(threads)
        self._turn = asyncio.Semaphore(threads)
        self._waiting: dict[str, asyncio.Task[Any]] = {}

    async def __call__(self, what: str, read: Callable[[], _T]) -> _T:
        """Return the value of `read`, begun after this call.

        All clients that ask for `what` before it is begun share it.
        """

        async def begin() -> _T:
            async with self._turn:
                del self._waiting[what]
                return await anyio.to_thread.run_sync(read, limiter=self._threads)

        if what not in self._waiting:
            self._waiting[what] = asyncio.create_task(begin())
        return await asyncio.shield(self._waiting[what])
