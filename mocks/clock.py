"""Clocks of a cell: simulated seconds run `time_scale` times faster than those on the wall; each device has its own.

On a `SteppedClock` they pass only while somebody waits for them: what happens then does not depend on the machine.
"""

from __future__ import annotations

import asyncio
import threading
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


class SteppedClock(CellClock):
    """Simulated seconds that cost none on the wall, shared by a cell and those who measure there, one at a time."""

    def __init__(self) -> None:
        super().__init__()
        self._now = 0.0
        self._lock = threading.Lock()

    def now(self) -> float:
        return self._now

    def step(self, seconds: float) -> None:
        """So many simulated seconds are over."""
        with self._lock:
            self._now += max(0.0, seconds)

    async def wait(self, seconds: float, until: asyncio.Event) -> bool:
        await asyncio.sleep(0)
        if until.is_set():
            return True
        self.step(seconds)
        return False


class DeviceClock(CellClock):
    """What a device stamps its readings with: the cell's time and an offset, which can step. It changes no waiting."""

    def __init__(self, cell: CellClock) -> None:
        super().__init__(cell.time_scale)
        self.cell = cell
        self.offset_s = 0.0

    def now(self) -> float:
        """Time of the device in s."""
        return self.cell.now() + self.offset_s

    async def wait(self, seconds: float, until: asyncio.Event) -> bool:
        return await self.cell.wait(seconds, until)

    def restart(self) -> None:
        """The device was switched on just now."""
        self.offset_s = -self.cell.now()
