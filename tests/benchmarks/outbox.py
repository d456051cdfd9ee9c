"""Benchmark of an outbox that sends its documents to the store through a lossy proxy.

The proxy loses and doubles three requests in ten. Server and sender are killed three times each and started again.
All documents must arrive exactly once. Server and sender are separate processes, killed by SIGKILL at any point.
The sender's clock jumps instead of waiting, so that the time is that of the work.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import IO

from fleet.outbox import FILE, Outbox
from fleet.store import FleetStore
from tests.fleet import documents
from tests.fleet.lossy import Lossy, lossy

RATE, RESTARTS = 0.3, 3
MEMORY = Path("/dev/shm")
_PAUSE = threading.Event()


class Server:
    """Process of `truepose fleet serve`."""

    def __init__(self, folder: Path) -> None:
        command = [sys.executable, "-m", "truepose", "fleet", "serve", "--json"]
        command += ["--store", f"sqlite:///{folder}/plant.sqlite3", "--token-file", str(folder / "tokens")]
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, encoding="utf-8")
        lines: IO[str] | None = self.process.stdout
        assert lines is not None
        hello = json.loads(lines.readline())
        self.port, self.token = int(hello["url"].rpartition(":")[2]), hello["token"]


def sender(folder: Path, proxy: Lossy, token: str) -> subprocess.Popen[bytes]:
    """A sender that ends when nothing waits."""
    module = "tests.benchmarks.outbox_sender"
    return subprocess.Popen([sys.executable, "-m", module, str(folder / FILE), str(proxy.port), token])


def kill(*processes: subprocess.Popen[bytes] | subprocess.Popen[str]) -> None:
    """SIGKILL, and wait for the end."""
    for process in processes:
        process.kill()
        process.wait()
        if process.stdout is not None:
            process.stdout.close()


def fill(folder: Path, count: int) -> list[str]:
    """Documents of 200 robots into the outbox, every tenth of them twice; their hashes."""
    hashes = []
    with Outbox(folder / FILE) as outbox:
        for i in range(count):
            robot = documents.RobotKey(f"robot-{i % 200}", "irb120")
            document = documents.model({"d1": 0.001 * i, "d2": 0.5}, robot=robot, day=i // 200)
            for _ in range(2 if i % 10 == 0 else 1):
                outbox.put(document, datetime.now(UTC))
            hashes.append(document.hash)
    return hashes


def send(folder: Path, proxy: Lossy, marks: Sequence[int]) -> None:
    """Send everything; kill server and sender when the requests reach each mark."""
    server = Server(folder)
    proxy.server = server.port
    process = sender(folder, proxy, server.token)
    for mark in marks:
        while proxy.requests < mark and process.poll() is None:
            _PAUSE.wait(0.01)
        assert process.poll() is None, "the sender has ended before it was killed"
        kill(server.process, process)
        proxy.server = None
        process = sender(folder, proxy, server.token)  # it is back before the server is
        server = Server(folder)
        proxy.server = server.port
    code = process.wait()
    kill(server.process)
    assert code == 0


def run(count: int) -> bool:
    """Return whether all documents have arrived exactly once."""
    home = str(MEMORY) if MEMORY.is_dir() else None
    with tempfile.TemporaryDirectory(prefix="truepose-outbox-", dir=home) as name, lossy(None, RATE) as proxy:
        folder = Path(name)
        begun = time.perf_counter()
        hashes = fill(folder, count)
        filled, own = time.perf_counter(), time.process_time()
        send(folder, proxy, [(number + 1) * count // (RESTARTS + 1) for number in range(RESTARTS)])
        seconds = time.perf_counter() - filled
        spent = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
        with FleetStore.open(f"sqlite:///{folder}/plant.sqlite3") as store, Outbox(folder / FILE) as outbox:
            there = store.documents(limit=2 * count)
            left = outbox.entries("waiting", "aside")
            conflicts = sum(entry.conflict for entry in there)
        found = [entry.hash for entry in there]
        missing, twice = len(set(hashes) - set(found)), len(found) - len(set(found))
    fates = ", ".join(f"{fate} {times}" for fate, times in sorted(proxy.fates.items()))
    print(
        f"{count} documents taken in in {filled - begun:.1f} s, sent in {seconds:.1f} s; load {os.getloadavg()[0]:.1f}"
    )
    print(
        f"processor time of {RESTARTS + 1} servers and senders {spent:.1f} s, their starts included; "
        f"of the proxy {time.process_time() - own:.1f} s"
    )
    print(f"{proxy.requests} requests came to the proxy: {fates}")
    print(f"server and sender killed {RESTARTS} times each")
    print(
        f"in the store {len(found)}, missing {missing}, twice {twice}, conflicts {conflicts}, not sent {len(left)}"
    )
    return sorted(found) == sorted(hashes) and not conflicts and not left
