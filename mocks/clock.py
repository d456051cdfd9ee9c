"""One clock for a cell: simulated seconds run `time_scale` times faster than those on the wall."""

from __future__ import annotations

import asyncio
import time
from collections.abc import Callable


class CellClock:
    """Simulated seconds since the start of the cell."""

    def __init__(self, time_scale: float = 1.0, wall: Callable[[], float] = time.monotonic) -> None:
        if not time_scale > 0:
            raise ValueError(f"time_scale must be positive, not {time_scale}")
        self.time_scale = time_scale
        self._wall = wall
        self._start = wall()

    def now(self) -> float:
        """Simulated time in s."""
        return (self._wall() - self._start) * self.time_scale

    async def wait(self, seconds: float, until: asyncio.Event) -> bool:
        """Wait so many simulated seconds, or until the event; True when the event came first."""
        try:
            await asyncio.wait_for(until.wait(), max(0.0, seconds / self.time_scale))
        except TimeoutError:
            return False
        return True
