"""State of one running service, kept in `app.state`.

It is created when the service starts and closed when the service ends.
"""

from __future__ import annotations

import asyncio
import socket
import time
from collections.abc import AsyncGenerator, Callable, Iterable, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Annotated, Any, TypeVar

import anyio
import anyio.to_thread
from fastapi import Depends, Request
from fastapi.responses import JSONResponse, Response

import acquisition
from acquisition import Cell, Devices, Event, Run, open_devices
from service.http.access.audit import Audit
from service.http.access.motion_lease import MotionLease
from service.http.access.roles import ServiceSettings
from service.http.runs.loops import LoopStore
from service.http.runs.run_cache import RunCache
from service.http.runs.run_document import FINAL
from service.http.runs.run_manager import RunManager
from service.http.runs.verifications import VerificationStore
from service.http.wire.problems import Problem, not_found
from service.http.work.campaigns import CampaignStore
from service.http.work.datasets import DatasetStore
from service.http.work.deletions import DeletionLog
from service.http.work.history import RobotHistory
from service.http.work.idempotency import IdempotencyKeys
from service.http.work.jobs import Jobs
from service.http.work.paging import ListPage
from service.http.work.readings import DocumentCache
from service.http.work.workers import Workers

_T = TypeVar("_T")
_AT_ONCE = 20  # events of a stream before others have their turn
SLICE_S = 1.0  # of a long poll: longest time for which it holds a thread after its client has left or the service ends
WAITERS = 100
STOPPERS = 16
ORDERS = 16
RESTING = 4
READERS = 2
ORDINARY = 24  # more than all calls of WORKERS and FILE_READERS together: those threads only wait
WORKERS, CALLS = 2, 12  # number of processes, and of calls that may wait for one
FILE_READERS, FILES, FILE_S = 2, 6, 30.0  # the same for files that users send, and the time for one of them


class Service:
    """Parts of the service. Create it within the event loop."""

    def __init__(self, settings: ServiceSettings) -> None:
        record = settings.record
        record.mkdir(parents=True, exist_ok=True)
        self.settings = settings
        self.keys = IdempotencyKeys(record)
        self.deletions = DeletionLog(record)
        self.workers = Workers(WORKERS, waiting=CALLS)
        # Files of users have separate processes, so that they never delay the planning of a run.
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
        self.ends = 0  # grows with each run, loop and job that has ended
        self.jobs = Jobs(record, self._ended)
        self.book.at_rest = self._ended
        self.lease = MotionLease(Audit(record))
        self.loops = LoopStore(
            record / "loops",
            self.book,
            self.datasets,
            self.devices,
            self.workers,
            simulated=settings.simulated is not None,
        )
        self.verifications = VerificationStore(
            record / "verifications",
            self.book,
            self.devices,
            self.workers,
            simulated=settings.simulated is not None,
        )
        self.closing = False
        # Separate threads: a stop must be received, however many clients ask, wait or read.
        self._stoppers = anyio.CapacityLimiter(STOPPERS)
        self._orders = anyio.CapacityLimiter(ORDERS)  # they are recorded first, so a slow disk may delay them
        self._resting = anyio.CapacityLimiter(RESTING)
        self._waiters = anyio.CapacityLimiter(WAITERS)
        self.reading = DocumentCache(READERS)  # state of a run, a loop or a job
        self.glances = RunCache(self.book, self.reading)
        self.listing = DocumentCache(1)  # lists of everything stored, which may be long
        self._watches: dict[str, asyncio.Task[int]] = {}
        self.stream_turns = asyncio.Lock()
        anyio.to_thread.current_default_thread_limiter().total_tokens = ORDINARY

    def _ended(self) -> None:
        self.ends += 1
        self.history.look()

    def models_of(self, table: Mapping[str, Any]) -> dict[str, Path]:
        """Return the files of the models of this service that the blocks of a campaign name, by id."""
        blocks = table.get("block")
        found: dict[str, Path] = {}
        for block in blocks if isinstance(blocks, list) else ():
            if isinstance(block, Mapping) and isinstance(name := block.get("model"), str):
                with suppress(Problem):
                    found[name] = self.jobs.model_file(name)
        return found

    def devices(self, cell: Cell) -> Devices:
        """Open the devices of a cell, or their simulators, without connecting them."""
        simulated = self.settings.simulated
        return open_devices(cell) if simulated is None else simulated.open(cell)

    @property
    def cell(self) -> Cell:
        """The cell of this service.

        Raises
        ------
        Problem
            404: the service has no cell.
        """
        if self.settings.cell is None:
            raise Problem(404, "This service has no cell.", "Start it with --cell CELL.toml.", code=8108)
        return self.settings.cell

    def let_move(self, lease_id: str, begin: Callable[[acquisition.LeaseDeadline], _T]) -> _T:
        """Begin a motion under the motion lease with this secret.

        If the lease is lost meanwhile, the run is paused at once.

        Raises
        ------
        Problem
            409: the lease is not held.
        """
        held = self.lease.needed(lease_id)
        begun = begin(held.beats)
        now = self.lease.current
        if now is None or now.beats is not held.beats:
            # The lease was taken over or given back meanwhile, when there was nothing to pause yet.
            self.rest(held.holder, f"{held.holder} no longer holds the motion lease.")
        return begun

    def rest(self, by: str, reason: str) -> None:
        """Pause the current run, loop or proof: after its reading, or between two runs."""
        for each in (self.book,) if self.book.lent_to is None else (self.loops, self.verifications):
            each.pause_all(by, reason)

    async def changed(self, what: str, wait: Callable[[float], int], after: int, seconds: float) -> None:
        """Wait for a version newer than `after`, the end of the service, or `seconds`.

        `wait` is called with a time in s; it waits up to that time for a new version and returns the version. One
        thread waits for all clients with the same `what`.
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

    async def event_batches(
        self, run_id: str, run: Run, seen: int, patience_s: float
    ) -> AsyncGenerator[list[Event]]:
        """Yield the events of a run behind `seen` as they happen, oldest first, at most 20 at once.

        An empty list comes if nothing has happened for `patience_s`. It ends with the service, or when nothing can
        happen to the run any more.
        """
        while not self.closing:
            async with self.stream_turns:  # one stream after another: a stop is heard between them
                events = await self.waiting(lambda after=seen: run.events(after, _AT_ONCE))
            if events:
                seen = events[-1].id
                yield events
                continue
            if (await self.waiting(run.status)).state in FINAL:
                return
            await self.changed(
                f"run {run_id}", lambda seconds, after=seen: run.wait(after, seconds), seen, patience_s
            )
            yield []

    def result(self, name: str) -> dict[str, Any]:
        """Return the document of a job of any kind, of a closed loop or of a verification, with its `kind`.

        Raises
        ------
        Problem
            404: there is none of this id.
        """
        kind = self.jobs.kind_of(name)
        if kind is not None:
            return self.jobs.document(kind, name)
        for store in (self.loops, self.verifications):
            if name in store.ids():
                return store.document(name) | {"kind": store.kind}
        raise not_found("result", name)

    async def waiting(self, what: Callable[[], _T]) -> _T:
        """Call `what` in one of the threads that may wait, and return its result."""
        return await anyio.to_thread.run_sync(what, limiter=self._waiters, abandon_on_cancel=True)

    async def urgent(self, what: Callable[[], _T]) -> _T:
        """Call `what` in a thread reserved for orders, answers and the lease; return its result."""
        return await anyio.to_thread.run_sync(what, limiter=self._orders)

    async def order(self, name: str, what: Callable[[], _T], *, stops: bool = False) -> _T:
        """Carry out an order to a run or a loop, in a reserved thread if it uses the robot.

        A stop has separate threads. Other runs move nothing, and their records may have to be opened, which can take
        seconds.
        """
        if name not in (self.book.busy_with, self.book.lent_to):
            return await anyio.to_thread.run_sync(what, limiter=self._resting)
        return await anyio.to_thread.run_sync(what, limiter=self._stoppers if stops else self._orders)

    async def listed(
        self,
        member: str,
        page: ListPage,
        keys: Callable[[], Iterable[str]],
        read: Callable[[str], dict[str, Any]],
        *,
        newest_first: bool = True,
    ) -> Response:
        """Return a page of a list as JSON, created once for all simultaneous requests.

        `member` holds the items; `keys` and `read` are those of `ListPage.take`, and `keys` is called first.
        """

        def work() -> tuple[bytes, str]:
            items, last = page.take(keys(), read, newest_first=newest_first)
            return bytes(JSONResponse({member: items}).body), last

        body, last = await self.listing(f"{page.url.path} {page.limit} {page.after}", work)
        return Response(body, headers=page.headers(last), media_type=JSONResponse.media_type)

    def end(self) -> None:
        """Begin the end of the service: refuse new work, release long polls, abandon computations."""
        self.closing = True
        self.book.refuse_new()
        self.workers.close()
        self.file_readers.close()
        self.jobs.end()
        self.history.close()
        self.loops.close()
        self.verifications.close()

    def close(self) -> None:
        """End the service, pause the run and close all parts."""
        self.end()
        self.book.close()
        self.jobs.close()
        self.keys.close()


async def _service(request: Request) -> Service:
    """Return the service of the application.

    It is a coroutine because FastAPI would run a plain function in one of the ordinary threads, and wait for it.
    """
    return request.app.state.service


Here = Annotated[Service, Depends(_service)]
