"""A worker with a stated build, as a separate program that does not restart.

Certificates come from Dask's settings.
"""

from __future__ import annotations

import asyncio
import sys


async def _worker(scheduler: str, build: str) -> None:
    from distributed import Worker

    from fleet.diagnose import batch, run

    batch.this_program = run.this_program = lambda: build
    async with Worker(scheduler, nthreads=1, host="127.0.0.1", dashboard_address="127.0.0.1:0") as it:
        print(it.address, flush=True)  # noqa: T201
        await it.finished()


if __name__ == "__main__":
    asyncio.run(_worker(*sys.argv[1:]))
