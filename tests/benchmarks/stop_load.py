"""`python -m tests.benchmarks.stop_load BASE_URL AUTHORIZATION RUN DATA.csv [LOAD]`.

Keep a service busy with clients. LOAD `silent` or `half` opens connections that send nothing, or half a header;
each is opened again within half a second when it is closed. LOAD `streams` opens streams of events that no client
reads.

Without LOAD, 200 clients ask for dry runs of 400 poses, dry runs whose body lists 5,000, uploads, diagnoses, long
polls and listings. Every client asks again as soon as it is answered, a refused one half a second later. When the
input closes, the program prints the answers, and the share of a core that the clients themselves took.
"""

from __future__ import annotations

import asyncio
import json
import random
import select
import socket
import sys
import threading
import time
from collections import Counter
from collections.abc import Awaitable, Callable
from contextlib import suppress
from itertools import cycle, islice
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import httpx2

CLIENTS, POSES, PAUSE_S = 200, 400, 0.5
HELD = {"silent": 1_100, "half": 1_100, "streams": 200}  # connections of each load that holds them
BLOCK: dict[str, Any] = {"set": "calibration", "count": POSES, "select": "random"}
CAMPAIGN: dict[str, Any] = {"format": "truepose-campaign/1", "block": [BLOCK]}
LISTED = 5_000  # poses of one body, as many as are taken
JSON = {"Content-Type": "application/json"}
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
            "large dry run": lambda: client.post("/runs", content=listed, headers=JSON),
            "upload": lambda: client.post("/datasets", files=files),
            "diagnosis": lambda: client.post("/diagnoses", json={"dataset_id": dataset}),
            "long poll": long_poll,
            "listing": lambda: client.get("/runs"),
        }
        listed = _listed()
        answered: Counter[str] = Counter()
        began, began_s = time.monotonic(), time.process_time()

        async def keep_asking(kind: str) -> None:
            while True:
                try:
                    status = (await kinds[kind]()).status_code
                except httpx2.TransportError as error:
                    status = type(error).__name__
                answered[f"{kind} {status}"] += 1
                if not (isinstance(status, int) and status < 300):
                    await asyncio.sleep(PAUSE_S)

        tasks = [asyncio.create_task(keep_asking(kind)) for kind in islice(cycle(kinds), CLIENTS)]
        sys.stdout.write("ready\n")
        sys.stdout.flush()
        await asyncio.to_thread(sys.stdin.read)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        core = (time.process_time() - began_s) / (time.monotonic() - began)
        sys.stdout.write(json.dumps({"answered": answered, "core": core}) + "\n")


def hold(base: str, authorization: str, run: str, load: str) -> None:
    """Hold connections, and open those again that are closed, until the input closes."""
    url = urlsplit(base)
    head = f"GET {url.path}/runs/{run}/events HTTP/1.1\r\nHost: {url.netloc}\r\n"
    sent = {"silent": "", "half": head, "streams": f"{head}Authorization: {authorization}\r\n\r\n"}[load]
    held: list[socket.socket] = []
    opened, told, closed = 0, False, threading.Event()
    threading.Thread(target=lambda: (sys.stdin.read(), closed.set()), daemon=True).start()
    while not closed.wait(PAUSE_S if told else 0.0):
        while len(held) < HELD[load]:
            opened += 1
            held.append(socket.create_connection((str(url.hostname), int(url.port or 80)), timeout=30.0))
            with suppress(OSError):
                held[-1].sendall(sent.encode())
        if not told:
            sys.stdout.write("ready\n")
            sys.stdout.flush()
            told = True
        for each in _gone(held) if load != "streams" else ():
            each.close()
            held.remove(each)
    sys.stdout.write(json.dumps({"answered": {f"{load} opened": opened}, "core": 0.0}) + "\n")


def _gone(held: list[socket.socket]) -> list[socket.socket]:
    """List the connections that the service has closed or answered.

    It uses `poll`, since descriptors exceed the range of `select`.
    """
    asked = select.poll()
    for each in held:
        asked.register(each, select.POLLIN)
    ready = {number for number, _ in asked.poll(0)}
    return [each for each in held if each.fileno() in ready]


def _listed() -> bytes:
    """A body of some 300 kB."""
    rng = random.Random(1)
    poses = [[round(rng.uniform(-40.0, 40.0), 4) for _ in range(6)] for _ in range(LISTED)]
    block = {"set": "calibration", "select": "list", "joints_deg": poses}
    return json.dumps({"campaign": CAMPAIGN | {"block": [block]}}).encode()


if __name__ == "__main__":
    _, url, token, run_id, csv, *which = sys.argv
    if which:
        hold(url, token, run_id, which[0])
    else:
        asyncio.run(main(url, token, run_id, Path(csv)))
