"""Two streams recorded in parallel: a thread reads each device, another writes the samples.

Every sample keeps the device's clock and the campaign time at which it arrived here. A missing sample is counted before
the next: from the device's own numbers if it has them, otherwise from its clock at the requested rate. Samples that
wait to be written are less than `CHUNK_S` of real time old; none is dropped when the disk is slow.
"""

from __future__ import annotations

import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import AbstractContextManager
from dataclasses import dataclass, field
from types import TracebackType

from acquisition.record.store import RecordStore
from acquisition.record.streams import Arrived, append
from acquisition.run.rig.rig import DevicePair
from drivers.errors import AcquisitionError, TargetNotSeen
from drivers.interfaces import Sample

CHUNK_S = 0.4  # on the wall, as all of these
SILENT_S = 5.0  # without a sample it is not known whether a stream flows
_LATE = 1.5  # periods after which a sample is missing


@dataclass
class Feed:
    """The stream of one device.

    `taken` is the number of samples so far, `lost` that of missing ones.
    """

    role: str
    rate_hz: float
    taken: int = 0
    lost: int = 0
    heard_s: float = field(default_factory=time.monotonic)
    flows: threading.Event = field(default_factory=threading.Event)
    waiting: deque[Arrived] = field(default_factory=deque)
    written: int = 0
    _last: Sample | None = None

    def take(self, sample: Sample, now_s: float) -> None:
        """Store a sample that has arrived at this time of the campaign."""
        lost = self._missing(sample)
        self._last = sample
        self.waiting.append(Arrived(sample.t_s, now_s, lost, bool(sample.doubt), sample.values))
        self.taken += 1
        self.lost += lost
        self.heard_s = time.monotonic()
        self.flows.set()

    def _missing(self, sample: Sample) -> int:
        last = self._last
        if last is None:
            return 0
        if sample.number is not None and last.number is not None:
            return max(0, sample.number - last.number - 1)
        periods = (sample.t_s - last.t_s) * self.rate_hz
        return round(periods) - 1 if periods > _LATE else 0


class Recorder:
    """The streams of one attempt at a path, while the block is open; `rates_hz` by role."""

    def __init__(
        self, store: RecordStore, attempt: int, rig: DevicePair, rates_hz: Mapping[str, float]
    ) -> None:
        self._store, self._attempt, self._rig = store, attempt, rig
        self.feeds = {role: Feed(role, rate) for role, rate in rates_hz.items()}
        self._ended = threading.Event()
        self._pool = ThreadPoolExecutor(len(self.feeds) + 1, thread_name_prefix="recorder")
        self._readers: dict[str, Future[None]] = {}
        self._writer: Future[None] | None = None

    def __enter__(self) -> Recorder:
        for role, feed in self.feeds.items():
            stream = self._rig.stream(role, feed.rate_hz)
            self._readers[role] = self._pool.submit(self._read, feed, stream)
        self._writer = self._pool.submit(self._write)
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End the streams and make all samples durable.

        An error of a stream or of the record is raised, unless another one is being raised already. The rig is informed
        in any case, and arms a device again that has disarmed itself.
        """
        self._ended.set()
        self._pool.shutdown(wait=True)
        if self._writer is not None and self._writer.exception() is None:
            self._flush()
        errors = self._errors()
        if error is None:
            self._raise_first(errors)

    def wait_until_both_flow(self) -> None:
        """Wait for the first sample of both streams. Errors of a stream are passed on.

        Raises
        ------
        TargetNotSeen
            A stream has no sample.
        """
        for feed in self.feeds.values():
            feed.flows.wait(SILENT_S)
        self.look()

    def look(self) -> None:
        """Check that both streams still flow.

        Raises
        ------
        TargetNotSeen
            A device has sent no sample for a while.
        LinkError, StorageError
            A stream or the writing of its samples failed.
        """
        self._raise_first(self._errors())
        now = time.monotonic()
        for feed in self.feeds.values():
            if not feed.taken or now - feed.heard_s > SILENT_S:
                raise TargetNotSeen(
                    f"the {feed.role} has sent no sample for {SILENT_S:g} s",
                    device=feed.role,
                    command="stream",
                )

    def _errors(self) -> list[AcquisitionError]:
        """Return the errors that ended streams.

        The rig notes their effect on the state of each device.
        """
        found = []
        for role, future in self._readers.items():
            try:
                if future.done():
                    with self._rig.using(role):
                        future.result()
            except AcquisitionError as error:
                found.append(error)
        return found

    def _raise_first(self, errors: list[AcquisitionError]) -> None:
        if errors:
            raise errors[0]
        if self._writer is not None and self._writer.done():
            self._writer.result()

    def _read(self, feed: Feed, stream: AbstractContextManager[Iterator[Sample | None]]) -> None:
        try:
            with stream as samples:
                for sample in samples:
                    if sample is not None:
                        feed.take(sample, self._store.moment().t_s or 0.0)
                    if self._ended.is_set():
                        return
        finally:
            feed.flows.set()  # do not wait for samples that will not come

    def _write(self) -> None:
        while not self._ended.wait(CHUNK_S):
            self._flush()

    def _flush(self) -> None:
        parts = []
        for feed in self.feeds.values():
            samples = [feed.waiting.popleft() for _ in range(len(feed.waiting))]
            if samples:
                parts.append((feed.role, feed.written, samples))
                feed.written += len(samples)
        if parts:
            append(self._store, self._attempt, parts)
