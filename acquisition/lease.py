"""Who moves the robot: one campaign at a time, and only while the one who answers for it is there.

`only_mover` is held for as long as devices are in use and keeps a second campaign of this computer, in whatever
record and whatever program, from moving the same robot. A `Lease` is for an owner who can fall silent without
the program ending (a page, a cell PC): it beats, and when it does not, the campaign pauses at the end of the move
or measurement under way. Stopping needs neither.
"""

from __future__ import annotations

import hashlib
import tempfile
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

from acquisition.clock import Clock, ScaledClock
from acquisition.errors import RobotInUse


@contextmanager
def only_mover(address: str) -> Iterator[None]:
    """Hold the robot at this address. Raises RobotInUse where another campaign of this computer does."""
    name = hashlib.sha256(address.encode()).hexdigest()[:16]
    lock = FileLock(Path(tempfile.gettempdir()) / f"truepose-robot-{name}.lock", thread_local=False)
    try:
        lock.acquire(timeout=0)
    except (Timeout, PermissionError) as error:  # the file of another user cannot even be opened
        raise RobotInUse(f"another campaign moves the robot at {address}", device="robot") from error
    try:
        yield
    finally:
        lock.release()


class Lease:
    """Ends `seconds` after the last beat, on the steady clock: a calendar that jumps does it no harm."""

    def __init__(self, owner: str, seconds: float, clock: Clock | None = None) -> None:
        self.owner = owner
        self._clock = clock or ScaledClock()
        self._told: list[threading.Event] = []  # one a watcher
        self.beat(seconds)

    def beat(self, seconds: float | None = None) -> None:
        """The owner is there, and will be heard of again within so many seconds. From any thread."""
        self.seconds = self.seconds if seconds is None else seconds
        self._ends = self._clock.now() + self.seconds
        for told in tuple(self._told):
            told.set()

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
        over, told = threading.Event(), threading.Event()

        def watch() -> None:
            while not over.is_set():
                told.clear()  # before the look: a beat after it wakes the wait
                left_s = self.left_s
                if left_s <= 0.0:
                    lapsed()
                    return
                if not over.is_set():
                    self._clock.wait(left_s, told)

        self._told.append(told)
        watcher = threading.Thread(target=watch, name="lease", daemon=True)
        watcher.start()
        try:
            yield
        finally:
            over.set()
            told.set()
            watcher.join()
            self._told.remove(told)
