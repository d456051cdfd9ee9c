"""`python -m tests.benchmarks.stop_load BASE_URL AUTHORIZATION RUN DATA.csv`: 200 clients who keep a service busy.

Dry runs of 400 poses, uploads, diagnoses, long polls and listings, forty clients each; every one asks again as soon as
it is answered, a refused one half a second later. Until the input closes; then it prints how they were answered.
"""

from __future__ import annotations

import asyncio
import json
import sys
from collections import Counter
from collections.abc import Awaitable, Callable
from pathlib import Path
from typing import Any

import httpx2

CLIENTS, POSES, PAUSE_S = 200, 400, 0.5
BLOCK: dict[str, Any] = {"set": "calibration", "count": POSES, "select": "random"}
CAMPAIGN: dict[str, Any] = {"format": "truepose-campaign/1", "block": [BLOCK]}
Ask = Callable[[], Awaitable[httpx2.Response]]


async def main(base: str, authorization: str, run: str, data: Path) -> None:
    """Keep the service busy until the input closes."""
    files = {"csv": data.read_bytes(), "toml": data.with_suffix(".toml").read_bytes()}
    limits = httpx2.Limits(max_connections=CLIENTS)
    async with httpx2.AsyncClient(
        base_url=base, headers={"Authorization": authorization}, timeout=120.0, limits=limits
    ) as client:
        dataset = (await client.post("/datasets", files=files)).json()["id"]

        async def long_poll() -> httpx2.Response:
            version = (await client.get(f"/runs/{run}")).json()["version"]
            return await client.get(f"/runs/{run}", params={"wait": 20, "after": version})

        kinds: dict[str, Ask] = {
            "dry run": lambda: client.post("/runs", json={"campaign": CAMPAIGN}),
            "upload": lambda: client.post("/datasets", files=files),
            "diagnosis": lambda: client.post("/diagnoses", json={"dataset_id": dataset}),
            "long poll": long_poll,
            "listing": lambda: client.get("/runs"),
        }
        answered: Counter[str] = Counter()

        async def keep_asking(kind: str) -> None:
            while True:
                try:
                    status = (await kinds[kind]()).status_code
                except httpx2.TransportError as error:
                    status = type(error).__name__
                answered[f"{kind} {status}"] += 1
                if not (isinstance(status, int) and status < 300):
                    await asyncio.sleep(PAUSE_S)

        tasks = [asyncio.create_task(keep_asking(kind)) for kind in [*kinds] * (CLIENTS // len(kinds))]
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        await asyncio.to_thread(sys.stdin.read)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        sys.stdout.write(json.dumps(answered) + "\n")


if __name__ == "__main__":
    _, url, token, run_id, csv = sys.argv
    asyncio.run(main(url, token, run_id, Path(csv)))
