"""Diagnosis of many data sets by many workers: distributed in batches, reported on return.

**Distribution.** The workers write finished results to the store; this end only distributes. It may be ended at any
time, and the same call later does the rest.

**Retries.** If the store does not answer, the call retries with one data set at a time, and fails after `STORE_S`
seconds. A database that is restarted or out of reach for an hour must not end the work of a night.

**Workers of a scheduler.** A worker gets work when it has reported that it runs the same program. It is asked when it
is first detected, also when it joins later, and then offers the resource that every batch requires. A worker of another
program offers none, so the scheduler gives it no work. `batch.work_off` checks the program again.

**Progress.** The progress of a call includes its cost.
"""

from __future__ import annotations

import os
import time
from collections import Counter, deque
from collections.abc import Callable, Sequence
from concurrent.futures import CancelledError
from dataclasses import dataclass
from typing import Any

from distributed import Client, Future, KilledWorker, Worker, wait
from distributed.comm.core import CommClosedError

from fleet.diagnose.batch import DatasetSource, DiagnosisOrder, EngineGone, work_off
from fleet.diagnose.changes import this_program
from fleet.diagnose.progress import ProgressCounts
from fleet.errors import StoreError, StoreGone

BATCH_S = 5.0
"""So long a batch shall take: a thousand times what the scheduler spends on it, and little is lost with a worker."""

AHEAD = 2  # batches for every worker: the next one is there when one is done
PATIENCE_S = 60.0  # without a worker
LOOK_S = 2.0

# Workers lost with a data set before it is given by itself, and then before it is the one that does it.
STRIKES = 2
_ENDS_WORKERS = "its worker ended each time that it was tried: too little memory?"
_AGAIN = "What is done is kept: see to it, then run the same command again."
STORE_S = 3600.0
FIRST_S, MOST_S = 1.0, 30.0  # between two questions: twice as long each time
BLAS = "OPENBLAS_NUM_THREADS"


def size_of(left: int, workers: int, seconds_each: float | None) -> int:
    """Choose the number of data sets of the next batch.

    A batch takes about `BATCH_S`. It has one data set before their time is known, and few towards the end, so that no
    one has to wait for the last one.
    """
    if seconds_each is None:
        return 1
    share = left // (2 * AHEAD * max(workers, 1))
    return max(1, min(share, round(BATCH_S / max(seconds_each, 1e-3))))


class FleetRun:
    """One call: the data sets that wait, and the batches at the workers."""

    def __init__(
        self,
        client: Client,
        order: DiagnosisOrder,
        sources: Sequence[DatasetSource],
        tell: Callable[[str], None],
    ) -> None:
        """Prepare a call for `sources`, which have no result yet.

        `tell` is called with sentences about workers.
        """
        self._client, self._order, self._tell = client, order, tell
        self._crew = WorkerPool(client, order.expected)
        self._waiting = deque(sources)
        self._alone: deque[DatasetSource] = (
            deque()
        )  # of batches that failed; they wait to be given by themselves
        self._strikes, self._strikes_by_itself = (
            Counter[DatasetSource](),
            Counter[DatasetSource](),
        )  # workers lost with it
        self._by_itself: Future | None = None  # the last one given so
        self._held: list[DatasetSource] = []  # another call works on them; claimed again later
        self._out: dict[Future, tuple[DatasetSource, ...]] = {}
        self._lost_before: dict[Future, int] = {}  # workers, when it was given
        self._store = StoreRetry(tell)
        self._begin = time.monotonic()
        self._spent = time.process_time()
        self._looked = self._manned = self._asked = self._begin
        self.tally = ProgressCounts(len(sources))

    def run(self, progress: Callable[[ProgressCounts], None]) -> ProgressCounts:
        """Diagnose all data sets; `progress` is called after every batch.

        A store that does not answer is waited for first. Finished results are kept, and the same call later does the
        rest.

        Raises
        ------
        EngineGone
            The scheduler or all workers are gone.
        StoreError
            Results cannot be kept.
        """
        try:
            self._look()
            self._begin, self._spent = time.monotonic(), time.process_time()
            while self._waiting or self._alone or self._held or self._out:
                self._deal()
                for future in self._ended():
                    self._take(future)
                    progress(self._counted())
                if time.monotonic() - self._looked >= LOOK_S:
                    self._look()
            self._see_who_is_there()  # a worker lost since the last check is reported, too
        except (CancelledError, CommClosedError) as error:
            raise EngineGone("the scheduler is gone.", do=_AGAIN) from error
        return self._counted()

    @property
    def in_hand(self) -> list[DatasetSource]:
        """The data sets that are at workers."""
        return [source for batch in self._out.values() for source in batch]

    def _see_who_is_there(self) -> None:
        for sentence in self._crew.look():
            self._tell(sentence)

    def _look(self) -> None:
        """Check which workers are there, and claim again the data sets of other calls.

        Raises
        ------
        EngineGone
            No worker has come.
        """
        self._see_who_is_there()
        self._looked = now = time.monotonic()
        if self._crew.lost and self._out:
            self._take_back()
        if self._crew.at_work:
            self._manned = now
        elif now - self._manned > PATIENCE_S:
            refused = "".join(f" {address}: {why}." for address, why in self._crew.refused.items())
            raise EngineGone(f"no worker has come for {PATIENCE_S:.0f} s.{refused}", do=_AGAIN)
        if self._held and now - self._asked >= self._order.lease_s / 3.0:
            if not (self._waiting or self._out):
                self._tell(
                    f"{len(self._held)} data sets are another call's, which works on them or has just ended"
                )
            self._asked = now
            self._waiting.extend(self._held)
            self._held.clear()

    def _take_back(self) -> None:
        """Distribute again the batches that no worker has.

        If all workers were lost, the scheduler does not check again when a new one is enrolled.
        """
        processing: Any = self._client.processing()
        somewhere = {key for keys in processing.values() for key in keys}
        for future, batch in list(self._out.items()):
            if future.status == "pending" and future.key not in somewhere:
                del self._out[future]
                future.cancel()
                struck = self._crew.lost > self._lost_before.pop(future)
                if future is self._by_itself:
                    self._again_by_itself(batch[0], struck)
                else:
                    self._again(batch, struck)

    def _again(self, batch: tuple[DatasetSource, ...], struck: bool) -> None:
        self._strikes.update(batch if struck else ())
        for source in batch:
            (self._alone if self._strikes[source] >= STRIKES else self._waiting).append(source)

    def _again_by_itself(self, source: DatasetSource, struck: bool) -> None:
        self._strikes_by_itself[source] += struck
        if self._strikes_by_itself[source] >= STRIKES:
            self.tally.failed[source.name] = _ENDS_WORKERS
        else:
            self._alone.append(source)

    def _deal(self) -> None:
        """Give every worker as many batches as it can have.

        To find a data set that ends workers, it is distributed alone. While the store does not answer, one data set is
        tried now and then.
        """
        if self._store.away and (self._out or not self._store.worth_asking()):
            return
        if self._alone and not self._out:
            self._look()  # who is there is beyond doubt
        if self._alone and not self._out and self._crew.at_work:
            self._by_itself = self._give((self._alone.popleft(),))
        at_work = len(self._crew.at_work)
        most = min(at_work, 1) if self._store.away else AHEAD * at_work
        while not self._alone and self._waiting and len(self._out) < most:
            size = 1 if self._store.away else size_of(len(self._waiting), at_work, self.tally.seconds_each)
            self._give(tuple(self._waiting.popleft() for _ in range(size)))

    def _give(self, batch: tuple[DatasetSource, ...]) -> Future:
        one = {resource(self._order.expected): 1.0}
        future = self._client.submit(work_off, batch, self._order, resources=one, pure=False)
        self._out[future] = batch
        self._lost_before[future] = self._crew.lost
        self.tally.batches += 1
        return future

    def _ended(self) -> list[Future]:
        """Wait for a batch to end, and return those that have ended."""
        if not self._out:
            time.sleep(LOOK_S / 10.0)  # for a worker, or for data sets of another call
            return []
        try:
            ended: Any = wait(list(self._out), timeout=LOOK_S, return_when="FIRST_COMPLETED")
        except TimeoutError:
            return []
        return list(ended.done)

    def _take(self, future: Future) -> None:
        """Count a batch that has ended.

        A batch whose result was lost with its worker before it came here is distributed again.
        """
        try:
            error: Any = future.exception(timeout=LOOK_S)
            outcome: Any = None if error is not None else future.result(timeout=LOOK_S)
        except (TimeoutError, KilledWorker):
            return
        batch = self._out.pop(future)
        del self._lost_before[future]
        if isinstance(error, StoreGone):
            self._store.refused(error)
            self._again(batch, struck=False)
            return
        if isinstance(error, (StoreError, EngineGone)):
            raise error
        if error is not None:
            if future is self._by_itself:
                self.tally.failed[batch[0].name] = _in_words(error)
            else:
                self._alone.extend(batch)
            return
        self._store.answered()
        tally = self.tally
        tally.done += outcome.done
        tally.refused += outcome.refused
        tally.twice += outcome.twice
        tally.seconds += outcome.seconds
        tally.found += outcome.found
        tally.failed |= {source.name: why for source, why in outcome.unseen}
        self._held += outcome.held

    def _counted(self) -> ProgressCounts:
        self.tally.elapsed = time.monotonic() - self._begin
        self.tally.overhead_s = time.process_time() - self._spent
        self.tally.workers, self.tally.lost = len(self._crew.at_work), self._crew.lost
        return self.tally


def _in_words(error: BaseException) -> str:
    if isinstance(error, KilledWorker):
        return _ENDS_WORKERS
    return f"the program failed ({type(error).__name__}: {error})"


class StoreRetry:
    """The waiting of one call for the store.

    `tell` is called when the store goes and comes back; `clock` returns seconds.
    """

    def __init__(self, tell: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._tell, self._clock = tell, clock
        self._since: float | None = None
        self._pause_s, self._next = FIRST_S, 0.0

    @property
    def away(self) -> bool:
        """Whether the store did not answer on the last attempt."""
        return self._since is not None

    def refused(self, error: StoreGone) -> None:
        """Note that the store does not answer, and raise the error if this lasts too long."""
        now = self._clock()
        if self._since is None:
            self._since, self._pause_s = now, FIRST_S
            self._tell(
                f"{error} Nothing that is done is lost; it is asked again for {STORE_S / 60:.0f} min, "
                "Ctrl-C ends the waiting"
            )
        elif now - self._since > STORE_S:
            raise error
        else:
            self._pause_s = min(2.0 * self._pause_s, MOST_S)
        self._next = now + self._pause_s

    def worth_asking(self) -> bool:
        """Check whether it is time to ask again."""
        return self._clock() >= self._next

    def answered(self) -> None:
        """Note that the store has answered."""
        if self._since is not None:
            self._tell(f"the store answers again, after {self._clock() - self._since:.0f} s")
            self._since = None


def resource(of: str) -> str:
    """Return the name of the resource that a worker of this program offers.

    One batch at a time uses it.
    """
    return f"truepose {of}"


@dataclass(frozen=True)
class WorkerReport:
    """A worker's report on itself.

    `threads` is the number of threads of its linear algebra, "" without a limit.
    """

    program: str
    threads: str


async def _enrol(expected: str, dask_worker: Worker) -> WorkerReport:
    """Enrol a worker; this runs on the worker."""
    told = WorkerReport(this_program(), os.environ.get(BLAS, ""))
    if told.program == expected:
        await dask_worker.set_resources(**{resource(expected): 1.0})
    return told


class WorkerPool:
    """The workers met so far: active ones, and refused ones with the reason, by address."""

    def __init__(self, client: Client, expected: str) -> None:
        self._client, self._expected = client, expected
        self.at_work: set[str] = set()
        self.refused: dict[str, str] = {}
        self.lost = 0

    def look(self) -> list[str]:
        """Ask new workers for their build, drop those that are gone, and return sentences on both.

        Raises
        ------
        CommClosedError
            The scheduler is gone.
        """
        told: Any = self._client.scheduler_info(n_workers=-1)
        if self._client.status != "running":  # then it reports its last state, or nothing
            raise CommClosedError("the connection to the scheduler is lost")
        present = set(told["workers"])
        said = []
        gone = self.at_work - present
        self.at_work -= gone
        self.lost += len(gone)
        said += [f"worker {address} is lost: its data sets go to others" for address in sorted(gone)]
        new = sorted(present - self.at_work - set(self.refused))
        if not new:
            return said
        answers: Any = self._client.run(_enrol, self._expected, workers=new, on_error="return")
        for address, told in answers.items():
            if isinstance(told, OSError):  # it has just gone, or is asked again
                continue
            why = self._why_not(told)
            if why:
                self.refused[address] = why
                said.append(f"worker {address} is refused: {why}")
                continue
            self.at_work.add(address)
            if told.threads != "1":
                said.append(f"worker {address} computes with more threads than one: start it with {BLAS}=1")
        return said

    def _why_not(self, told: object) -> str:
        """Return why a worker may not compute, according to its answer; "" if it may."""
        if not isinstance(told, WorkerReport):
            return f"it cannot say which TruePose it runs ({type(told).__name__}: {told}); install {self._expected}"
        if told.program != self._expected:
            return (
                f"it runs TruePose {told.program}, this is {self._expected}; install the same version there"
            )
        return ""
