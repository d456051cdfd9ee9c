"""The state of one running service, made when it starts and given up when it ends; lives in `app.state`."""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import Callable
from typing import Annotated, Any, TypeVar

import anyio
import anyio.to_thread
from fastapi import Depends, Request
from fastapi.responses import JSONResponse, Response

import acquisition
from acquisition import Cell, Devices, open_devices
from service.http.access.audit import Audit
from service.http.access.motion_lease import MotionLease
from service.http.access.roles import ServiceSettings
from service.http.runs.loops import LoopStore
from service.http.runs.run_cache import RunCache
from service.http.runs.run_manager import RunManager
from service.http.wire.problems import Problem
from service.http.work.campaigns import CampaignStore
from service.http.work.datasets import DatasetStore
from service.http.work.deletions import DeletionLog
from service.http.work.history import RobotHistory
from service.http.work.idempotency import IdempotencyKeys
from service.http.work.jobs import Jobs
from service.http.work.readings import DocumentCache
from service.http.work.workers import Workers

_T = TypeVar("_T")
SLICE_S = 1.0  # of a long poll: how long a client that has gone, or the end of the service, may hold a thread
WAITERS = 100
STOPPERS = 16
ORDERS = 16
RESTING = 4
READERS = 2
ORDINARY = 24  # more than all calls of WORKERS and FILE_READERS together: those threads only wait
WORKERS, CALLS = 2, 12  # processes, and calls that may wait for one
FILE_READERS, FILES, FILE_S = 2, 6, 30.0  # the same for files that users send, and the time for one of them


class Service:
    """The parts of the service. Made within the event loop."""

    def __init__(self, settings: ServiceSettings) -> None:
        record = settings.record
        record.mkdir(parents=True, exist_ok=True)
        self.settings = settings
        self.keys = IdempotencyKeys(record)
        self.deletions = DeletionLog(record)
        self.workers = Workers(WORKERS, waiting=CALLS)
        # Files of users have processes of their own: none of them keeps a run from being planned
        self.file_readers = Workers(FILE_READERS, waiting=FILES, most_s=FILE_S)
        self.book = RunManager(
            record / "runs", self.devices, self.workers, simulated=settings.simulated is not None
        )
        self.shelf = CampaignStore(record / "campaigns")
        self.datasets = DatasetStore(record / "datasets")
        self.history = RobotHistory(
            record,
            settings.store,
            socket.gethostname() if settings.cell is None else settings.cell.name,
            simulated=settings.simulated is not None,
            permitted_mm=settings.permitted_mm,
        )
        self.jobs = Jobs(record, self.history.look)
        self.book.at_rest = self.history.look
        self.lease = MotionLease(Audit(record))
        self.loops = LoopStore(
            record / "loops",
            self.book,
            self.datasets,
            self.devices,
            self.workers,
            simulated=settings.simulated is not None,
        )
        self.closing = False
        # Threads of their own: however many ask, wait or read, a stop must be heard.
        self._stoppers = anyio.CapacityLimiter(STOPPERS)
        self._orders = anyio.CapacityLimiter(ORDERS)  # which are written down first: a disk may hold them
        self._resting = anyio.CapacityLimiter(RESTING)
        self._waiters = anyio.CapacityLimiter(WAITERS)
        self.reading = DocumentCache(READERS)  # how a run, a loop or a job is
        self.glances = RunCache(self.book, self.reading)
        self.listing = DocumentCache(1)  # everything that was kept, which may be much
        self._watches: dict[str, asyncio.Task[int]] = {}
        self.stream_turns = asyncio.Lock()
        anyio.to_thread.current_default_thread_limiter().total_tokens = ORDINARY

    def devices(self, cell: Cell) -> Devices:
        """The devices of a cell, or their simulators, not yet connected."""
        simulated = self.settings.simulated
        return open_devices(cell) if simulated is None else simulated.open(cell)

    @property
    def cell(self) -> Cell:
        """The cell of this service. Raises Problem 404 where it has none."""
        if self.settings.cell is None:
            raise Problem(404, "This service has no cell.", "Start it with --cell CELL.toml.", code=8108)
        return self.settings.cell

    def let_move(self, lease_id: str, begin: Callable[[acquisition.LeaseDeadline], _T]) -> _T:
        """Begin a motion by leave of the lease with this secret. Raises Problem 409 without one."""
        held = self.lease.needed(lease_id)
        begun = begin(held.beats)
        now = self.lease.current
        if now is None or now.beats is not held.beats:
            # It was taken over or given back meanwhile, which found nothing to pause.
            self.rest(held.holder, f"{held.holder} no longer holds the motion lease.")
        return begun

    def rest(self, by: str, reason: str) -> None:
        """Pause the run that moves the robot after the current reading, a loop also between two runs."""
        whole = self.book if self.book.lent_to is None else self.loops
        whole.pause_all(by, reason)

    async def changed(self, what: str, wait: Callable[[float], int], after: int, seconds: float) -> None:
        """Wait until a version beyond `after` is there, the service ends, or so many seconds have passed.

        wait: waits up to so many seconds for it, and returns the version. However many clients wait for the same
        thing, one thread does.
        """
        end = time.monotonic() + seconds
        while not self.closing and (left := end - time.monotonic()) > 0.0:
            watch = self._watches.get(what)
            if watch is None:
                watch = asyncio.create_task(self.waiting(lambda: wait(SLICE_S)))
                self._watches[what] = watch
                watch.add_done_callback(lambda _: self._watches.pop(what))
            await asyncio.wait({watch}, timeout=left)
            if watch.done() and watch.result() > after:
                return

    async def waiting(self, what: Callable[[], _T]) -> _T:
        """The value of `what`, called in one of the threads that may wait."""
        return await anyio.to_thread.run_sync(what, limiter=self._waiters, abandon_on_cancel=True)

    async def urgent(self, what: Callable[[], _T]) -> _T:
        """The value of `what`, called in a thread that is kept for orders, answers and the lease."""
        return await anyio.to_thread.run_sync(what, limiter=self._orders)

    async def order(self, name: str, what: Callable[[], _T], *, stops: bool = False) -> _T:
        """An order to a run or a loop: urgent for the one that uses the robot; a stop has threads of its own.

        The others move nothing, and their records may have to be opened, which can take seconds.
        """
        if name not in (self.book.busy_with, self.book.lent_to):
            return await anyio.to_thread.run_sync(what, limiter=self._resting)
        return await anyio.to_thread.run_sync(what, limiter=self._stoppers if stops else self._orders)

    async def listed(self, name: str, documents: Callable[[], list[dict[str, Any]]]) -> Response:
        """All documents of a kind under this name, as JSON that is made once for all who ask meanwhile."""

        def read() -> bytes:
            return bytes(JSONResponse({name: documents()}).body)

        return Response(await self.listing(name, read), media_type=JSONResponse.media_type)

    def end(self) -> None:
        """The service shall end: nothing new begins, long polls are let go, what is computed is given up."""
        self.closing = True
        self.book.refuse_new()
        self.workers.close()
        self.file_readers.close()
        self.jobs.end()
        self.history.close()
        self.loops.close()

    def close(self) -> None:
        """Pause what runs, give everything up."""
        self.end()
        self.book.close()
        self.jobs.close()
        self.keys.close()


async def _service(request: Request) -> Service:
    """The service, found in the event loop: a plain function would wait for one of the ordinary threads."""
    return request.app.state.service


Here = Annotated[Service, Depends(_service)]
