"""Programs of their own for the tests: a scheduler, and a worker whose build can be told; neither restarts."""

from __future__ import annotations

import asyncio
import sys


async def _scheduler() -> None:
    from distributed import Scheduler

    async with Scheduler(host="127.0.0.1", port=0, dashboard=False, dashboard_address="127.0.0.1:0") as it:
        print(it.address, flush=True)  # noqa: T201
        await it.finished()


async def _worker(scheduler: str, build: str) -> None:
    from distributed import Worker

    from fleet.diagnose import batch, crew

    if build:
        batch.this_program = crew.this_program = lambda: build
    async with Worker(scheduler, nthreads=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as it:
        print(it.address, flush=True)  # noqa: T201
        await it.finished()


if __name__ == "__main__":
    what, *arguments = sys.argv[1:]
    asyncio.run(_scheduler() if what == "scheduler" else _worker(*arguments))
