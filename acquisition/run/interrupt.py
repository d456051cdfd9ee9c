"""Ctrl-C at the terminal: once pauses after the reading in hand, twice stops the robot now."""

from __future__ import annotations

import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

from acquisition.run.run import Run


@contextmanager
def pausing_on_interrupt(run: Run, by: str = "terminal") -> Iterator[None]:
    """While the block runs, in the main thread, SIGINT and SIGTERM are orders to the run."""
    seen = threading.Event()

    def heard(number: int, frame: FrameType | None) -> None:
        # In a thread of its own: the main thread may be inside the record right now.
        order = run.stop if seen.is_set() else run.pause
        seen.set()
        threading.Thread(target=order, args=(by,), daemon=True).start()

    before = {number: signal.signal(number, heard) for number in (signal.SIGINT, signal.SIGTERM)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
