"""Who moves the robot: one campaign at a time, and only while the one who answers for it is there.

`only_mover` is held for as long as devices are in use and keeps a second campaign of this computer, in whatever
record and whatever program, from moving the same robot. A `Lease` is for an owner who can fall silent without
the program ending (a page, a cell PC): it beats, and when it does not, the campaign pauses after the reading in
hand. Stopping needs neither.
"""

from __future__ import annotations

import hashlib
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from filelock import FileLock, Timeout

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

    def __init__(self, owner: str, seconds: float) -> None:
        self.owner, self.seconds = owner, seconds
        self.beat()

    def beat(self) -> None:
        """The owner is there. From any thread."""
        self._ends = time.monotonic() + self.seconds

    @property
    def left_s(self) -> float:
        """Seconds until it ends; not positive once it has."""
        return self._ends - time.monotonic()

    @contextmanager
    def watched(self, lapsed: Callable[[], None]) -> Iterator[None]:
        """Call `lapsed` once, in a thread of its own, if it ends within the block; at once if it has ended."""
        over = threading.Event()

        def watch() -> None:
            while (left := self.left_s) > 0.0:
                if over.wait(left):
                    return
            lapsed()

        if self.left_s <= 0.0:
            lapsed()
            yield
            return
        watcher = threading.Thread(target=watch, name="lease", daemon=True)
        watcher.start()
        try:
            yield
        finally:
            over.set()
            watcher.join()
