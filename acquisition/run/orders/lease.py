"""The lease of a run: the robot moves only while the person or client responsible is there.

A `LeaseDeadline` is for an owner who can fall silent without the program ending (a page, a cell PC). The owner sends
beats. When they stop, the campaign pauses at the end of the current move or measurement. Stopping needs no lease.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from acquisition.run.clock import Clock, ScaledClock


class LeaseDeadline:
    """A deadline `seconds` after the last beat of its owner.

    It uses the steady clock, so that a calendar that jumps does no harm.
    """

    def __init__(self, owner: str, seconds: float, clock: Clock | None = None) -> None:
        self.owner = owner
        self._clock = clock or ScaledClock()
        self._heard: list[threading.Event] = []  # one a watcher
        self.beat(seconds)

    def beat(self, seconds: float | None = None) -> None:
        """Record that the owner is there, and will beat again within `seconds`. From any thread."""
        self.seconds = self.seconds if seconds is None else seconds
        self._ends = self._clock.now() + self.seconds
        for heard in tuple(self._heard):
            heard.set()

    @property
    def left_s(self) -> float:
        """Seconds until the lease ends; not positive once it has ended."""
        return self._ends - self._clock.now()

    @contextmanager
    def watched(self, lapsed: Callable[[], None]) -> Iterator[None]:
        """Call `lapsed` once, in a separate thread, if the lease ends within the block.

        If it has ended before, `lapsed` is called at once.
        """
        if self.left_s <= 0.0:
            lapsed()
            yield
            return
        over, heard = threading.Event(), threading.Event()

        def watch() -> None:
            while not over.is_set():
                heard.clear()  # before the look: a beat after it wakes the wait
                left_s = self.left_s
                if left_s <= 0.0:
                    lapsed()
                    return
                if not over.is_set():
                    self._clock.wait(left_s, heard)

        self._heard.append(heard)
        watcher = threading.Thread(target=watch, name="lease", daemon=True)
        watcher.start()
        try:
            yield
        finally:
            over.set()
            heard.set()
            watcher.join()
            self._heard.remove(heard)
