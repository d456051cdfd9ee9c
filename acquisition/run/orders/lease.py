"""The lease of a run: the robot moves only while the one who answers for it is there.

A `LeaseDeadline` is for an owner who can fall silent without the program ending (a page, a cell PC): it beats, and
when it does not, the campaign pauses at the end of the move or measurement under way. Stopping needs none.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

from acquisition.run.clock import Clock, ScaledClock


class LeaseDeadline:
    """Ends `seconds` after the last beat, on the steady clock: a calendar that jumps does it no harm."""

    def __init__(self, owner: str, seconds: float, clock: Clock | None = None) -> None:
        self.owner = owner
        self._clock = clock or ScaledClock()
        self._heard: list[threading.Event] = []  # one a watcher
        self.beat(seconds)

    def beat(self, seconds: float | None = None) -> None:
        """The owner is there, and will be heard of again within so many seconds. From any thread."""
        self.seconds = self.seconds if seconds is None else seconds
        self._ends = self._clock.now() + self.seconds
        for heard in tuple(self._heard):
            heard.set()

    @property
    def left_s(self) -> float:
        """Seconds until it ends; not positive once it has."""
        return self._ends - self._clock.now()

    @contextmanager
    def watched(self, lapsed: Callable[[], None]) -> Iterator[None]:
        """Call `lapsed` once, in a thread of its own, if it ends within the block; at once if it has ended."""
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
