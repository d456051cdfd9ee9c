"""What one running service holds, made when it starts and given up when it ends; lives in `app.state`."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Annotated, TypeVar

import anyio
import anyio.to_thread
from fastapi import Depends, Request

import acquisition
from acquisition import Cell, Devices, open_devices
from service.http.audit import Audit
from service.http.book import Book
from service.http.campaigns import Shelf
from service.http.datasets import Datasets
from service.http.idempotency import Keys
from service.http.jobs import Jobs
from service.http.lease import Lease
from service.http.loops import Loops
from service.http.problems import Problem
from service.http.settings import Settings

_T = TypeVar("_T")
SLICE_S = 1.0  # of a long poll: how long a client that has gone, or the end of the service, may hold a thread
WAITERS = 100
STOPPERS = 4


class Service:
    """The parts of the service. Made within the event loop."""

    def __init__(self, settings: Settings) -> None:
        record = settings.record
        record.mkdir(parents=True, exist_ok=True)
        self.settings = settings
        self.keys = Keys(record)
        self.book = Book(record / "runs", self._open_devices, simulated=settings.simulated is not None)
        self.shelf = Shelf(record / "campaigns")
        self.datasets = Datasets(record / "datasets")
        self.jobs = Jobs(record)
        self.lease = Lease(Audit(record))
        self.loops = Loops(
            record / "loops",
            self.book,
            self.datasets,
            self._open_devices,
            simulated=settings.simulated is not None,
        )
        self.closing = False
        # Threads of their own: a hundred clients that wait must never keep a stop from being heard.
        self._waiters = anyio.CapacityLimiter(WAITERS)
        self._stoppers = anyio.CapacityLimiter(STOPPERS)

    def _open_devices(self, cell: Cell) -> Devices:
        simulated = self.settings.simulated
        return open_devices(cell) if simulated is None else simulated.open(cell)

    @property
    def cell(self) -> Cell:
        """Raises Problem 404 where the service has none."""
        if self.settings.cell is None:
            raise Problem(404, "This service has no cell.", "Start it with --cell CELL.toml.", code=8108)
        return self.settings.cell

    def let_move(self, lease_id: str, begin: Callable[[acquisition.Lease], _T]) -> _T:
        """Begin a motion by leave of the lease with this secret. Raises Problem 409 without one."""
        held = self.lease.needed(lease_id)
        begun = begin(held.beats)
        now = self.lease.current
        if now is None or now.beats is not held.beats:
            # It was taken over or given back meanwhile, which found nothing to pause.
            self.rest(held.holder, f"{held.holder} no longer holds the motion lease.")
        return begun

    def rest(self, by: str, reason: str) -> None:
        """What moves the robot pauses after the reading in hand, a loop also between two runs."""
        whole = self.book if self.book.lent_to is None else self.loops
        whole.pause_all(by, reason)

    async def changed(self, wait: Callable[[float], bool], seconds: float) -> None:
        """Until `wait(slice)` is true, the service ends, or so many seconds have passed."""
        end = time.monotonic() + seconds
        while not self.closing and (left := end - time.monotonic()) > 0.0:
            if await self.waiting(lambda left=left: wait(min(left, SLICE_S))):
                return

    async def waiting(self, what: Callable[[], _T]) -> _T:
        """In a thread of those that may wait."""
        return await anyio.to_thread.run_sync(what, limiter=self._waiters, abandon_on_cancel=True)

    async def urgent(self, what: Callable[[], _T]) -> _T:
        """In a thread that is kept for stopping."""
        return await anyio.to_thread.run_sync(what, limiter=self._stoppers)

    def close(self) -> None:
        """Pause what runs, give everything up."""
        self.closing = True
        self.loops.close()
        self.book.close()
        self.jobs.close()
        self.keys.close()


def _service(request: Request) -> Service:
    return request.app.state.service


Here = Annotated[Service, Depends(_service)]
