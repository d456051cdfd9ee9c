"""Wait for a condition with a deadline, and run a blocking verb in a separate thread."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any

from mocks.cell import CellThread

# Seconds for what surely comes; a process that the machine starves may take long, and nothing waits in vain. Below the
# limit of pytest for one test, so that whoever waited says for what.
PATIENCE_S = 240.0


def until(condition: Callable[[], Any], seconds: float = PATIENCE_S) -> None:
    """Poll until the condition holds; fail after a number of seconds."""
    end = time.monotonic() + seconds
    pause = threading.Event()
    while not condition():
        assert time.monotonic() < end, "condition did not come true"
        pause.wait(0.005)


def in_thread(verb: Callable[[], Any]) -> Future[Any]:
    """Run a verb in a thread next to the test, and return its future."""
    pool = ThreadPoolExecutor(max_workers=1)
    future = pool.submit(verb)
    pool.shutdown(wait=False)
    return future


def under_way(arm: Any, target: Sequence[float], cell: CellThread) -> Future[Any]:
    """Start a move, wait until the simulated robot has begun it, and return its future."""
    move = in_thread(lambda: arm.move_to(target))
    until(lambda: cell.do("state")["moving"])
    return move
