"""Clocks of a cell: simulated seconds run `time_scale` times faster than real ones.

Each device has its own clock. On a `SteppedClock`, simulated seconds pass only while a client waits for them,
so that the results do not depend on the machine.
"""

from __future__ import annotations

import asyncio
import threading
import time
from collections import deque
from collections.abc import AsyncIterator, Callable, Iterator
from contextlib import contextmanager
from typing import Generic, TypeVar

T = TypeVar("T")
REMEMBERED = 100  # changes of a value: more than happen within MOST_LATE_S

QUICKEST_S = 0.001  # between two ticks on the wall, however fast the cell's clock runs
MOST_LATE_S = 0.25  # on the wall, that a late tick is made up for; what is older is left out


class CellClock:
    """Simulated seconds since the start of the cell."""

    def __init__(self, time_scale: float = 1.0, wall: Callable[[], float] = time.monotonic) -> None:
        if not time_scale > 0:
            raise ValueError(f"time_scale must be positive, not {time_scale}")
        self.time_scale = time_scale
        self._wall = wall
        self._start = wall()
        self._held: float | None = None

    def now(self) -> float:
        """Simulated time in s."""
        return (self._wall() - self._start) * self.time_scale if self._held is None else self._held

    @contextmanager
    def held(self, at_s: float) -> Iterator[None]:
        """Hold the time of the cell at one instant within the block.

        Nothing may be awaited there.
        """
        self._held = at_s
        try:
            yield
        finally:
            self._held = None

    async def ticks(self, period_s: float) -> AsyncIterator[tuple[int, float]]:
        """Yield a tick per period of simulated seconds.

        A tick is its number and the instant of the cell at which it was due. A sampler that the machine has delayed
        catches up, as a real one is never late.
        """
        every_s = period_s / self.time_scale
        begun, number = self._wall(), 0
        while every_s < QUICKEST_S:  # no machine follows this clock: the samples are fewer, and of now
            await asyncio.sleep(QUICKEST_S)
            number += 1
            yield number, self.now()
        while True:
            number += 1
            late_s = self._wall() - begun - number * every_s
            await asyncio.sleep(
                max(0.0, -late_s)
            )  # the cell's other tasks have their turn, however late this one is
            if late_s <= MOST_LATE_S:
                yield number, (begun - self._start + number * every_s) * self.time_scale

    async def wait(self, seconds: float, until: asyncio.Event) -> bool:
        """Wait for simulated seconds, or until the event; True if the event came first."""
        try:
            await asyncio.wait_for(until.wait(), max(0.0, seconds / self.time_scale))
        except TimeoutError:
            return False
        return True


class Past(Generic[T]):
    """A value that changes at instants of the cell.

    Within `CellClock.held`, it has the value of that instant.
    """

    def __init__(self, now: Callable[[], float], value: T) -> None:
        self._now = now
        self._changes: deque[tuple[float, T]] = deque([(0.0, value)], maxlen=REMEMBERED)

    @property
    def value(self) -> T:
        """The value now, or at the instant that is held."""
        now = self._now()
        return next((value for since, value in reversed(self._changes) if since <= now), self._changes[0][1])

    def change(self, value: T) -> None:
        """Change the value from now on."""
        self._changes.append((self._now(), value))


class SteppedClock(CellClock):
    """Simulated seconds that take no real time.

    A cell and its clients share the clock; one client measures at a time.
    """

    def __init__(self) -> None:
        super().__init__()
        self._now = 0.0
        self._lock = threading.Lock()

    def now(self) -> float:
        return self._now

    def step(self, seconds: float) -> None:
        """Advance the clock by simulated seconds."""
        with self._lock:
            self._now += max(0.0, seconds)

    async def ticks(self, period_s: float) -> AsyncIterator[tuple[int, float]]:
        async for number, _ in super().ticks(period_s):
            yield number, self._now
            await asyncio.sleep(QUICKEST_S)

    async def wait(self, seconds: float, until: asyncio.Event) -> bool:
        await asyncio.sleep(0)
        if until.is_set():
            return True
        self.step(seconds)
        return False


class DeviceClock(CellClock):
    """The clock of a device's time stamps.

    It has the cell's time with a wrong rate and an offset, which can step. It does not affect waiting.
    """

    def __init__(self, cell: CellClock) -> None:
        super().__init__(cell.time_scale)
        self.cell = cell
        self.offset_s = 0.0
        self.rate = 0.0  # seconds too many in a second

    def now(self) -> float:
        """Time of the device in s."""
        return (1.0 + self.rate) * self.cell.now() + self.offset_s

    @contextmanager
    def held(self, at_s: float) -> Iterator[None]:
        with self.cell.held(at_s):
            yield

    async def ticks(self, period_s: float) -> AsyncIterator[tuple[int, float]]:
        async for tick in self.cell.ticks(period_s):
            yield tick

    async def wait(self, seconds: float, until: asyncio.Event) -> bool:
        return await self.cell.wait(seconds, until)

    def restart(self) -> None:
        """Restart the clock, as when the device is switched on."""
        self.offset_s = -(1.0 + self.rate) * self.cell.now()
