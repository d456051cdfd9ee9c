"""Benchmark of 200 status requests per second during a campaign: late readings, answers.

For the first half of the time no client asks, for the second every client does. A reading is late by the time from
the arrival at its pose to the reading, less the shortest such time of the campaign. Service, simulators and clients
are three programs.
"""

from __future__ import annotations

import asyncio
import json
import tempfile
import time
import tomllib
from datetime import datetime
from pathlib import Path
from typing import Any

import httpx2

from tests.benchmarks.clock import line
from tests.end_to_end.simulated import campaign_file, cell_file
from tests.service.test_http_support import Served, served

EACH_S, SCALE = 30.0, 10.0
RATE, LATE_S = 200.0, 0.1


def run() -> bool:
    """Print the results; return whether no reading is late and all answers keep pace."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        cell = cell_file(folder, time_scale=SCALE)
        with served(folder / "record", "--cell", str(cell), "--simulate") as service:
            file = campaign_file(folder, warm_up_s=0.0, settle_s=2.0, samples=5, reference_every=0)
            own = service.begin(tomllib.loads(file.read_text("utf-8")))
            time.sleep(EACH_S)
            turned = time.time()
            took = asyncio.run(_ask(service, f"/runs/{own}"))
            lags = _lags(service, own)
            service.client.post(f"/runs/{own}/stop")
    floor = min(lag for _, lag in lags)
    quiet, busy = ([lag - floor for at, lag in lags if (at > turned) is which] for which in (False, True))
    line("a reading later than the soonest, nobody asks: max", f"{1e3 * max(quiet):.0f} ms", "", True)
    good = max(busy) < LATE_S
    line(
        f"the same, {RATE:g} status requests a second: max of {len(busy)}",
        f"{1e3 * max(busy):.0f} ms",
        f"< {1e3 * LATE_S:g} ms",
        good,
    )
    took.sort()
    rate = len(took) / EACH_S
    line("status requests answered a second", f"{rate:.0f}", f"{RATE:g}", rate > 0.99 * RATE)
    figures = f"{1e3 * took[len(took) // 2]:.0f} / {1e3 * took[len(took) * 99 // 100]:.0f} / {1e3 * took[-1]:.0f} ms"
    line("the answer to one: median / 99 % / max", figures, "", True)
    return good and rate > 0.99 * RATE


async def _ask(service: Served, path: str) -> list[float]:
    """Ask at an even pace, without waiting for answers; return the response times, s."""
    took: list[float] = []
    async with httpx2.AsyncClient(
        base_url=service.client.base_url,
        headers=service.client.headers,
        timeout=60.0,
        limits=httpx2.Limits(max_connections=50),
    ) as client:

        async def one() -> None:
            began = time.perf_counter()
            assert (await client.get(path)).status_code == 200
            took.append(time.perf_counter() - began)

        began, asked = time.perf_counter(), []
        while (at := time.perf_counter() - began) < EACH_S:
            while len(asked) < at * RATE:
                asked.append(asyncio.create_task(one()))
            await asyncio.sleep(0.002)
        await asyncio.gather(*asked)
    return took


def _lags(service: Served, own: str) -> list[tuple[float, float]]:
    """List time and delay after the arrival of each pose's first reading; wall clock, s."""
    found, arrived = [], None
    for text in service.client.get(f"/runs/{own}/events.jsonl").text.splitlines():
        event: dict[str, Any] = json.loads(text)
        if event["kind"] == "arrived":
            arrived = _seconds(event["utc"])
        elif event["kind"] == "reading" and arrived is not None:
            found.append((_seconds(event["utc"]), _seconds(event["utc"]) - arrived))
            arrived = None
    return found


def _seconds(utc: str | float) -> float:
    return datetime.fromisoformat(utc).timestamp() if isinstance(utc, str) else utc
