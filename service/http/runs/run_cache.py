"""Cached state of the run that uses the robot, as JSON that is kept for a moment.

Reading a run means questions to SQLite in another thread, and a turn of the interpreter for each. The thread
that measures has to wait for these turns. While nothing has been written to the record, the answer changes only
in the remaining time. Two hundred clients per second therefore cost four readings per second; the other answers
come out of the event loop.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

from service.http.runs.run_document import FINAL
from service.http.runs.run_manager import RunManager
from service.http.wire.bodies import RunResponse
from service.http.work.readings import DocumentCache

KEPT_S = 0.25
"""How old `seconds_left` may be, s. What is written to the record is seen at once."""


@dataclass(frozen=True)
class RunSnapshot:
    """A run at one moment.

    `still` says that nothing can happen to it any more. `changes` is the value of `RunManager.changes` before it
    was read.
    """

    run_id: str
    version: int
    still: bool
    body: bytes
    changes: int | None
    at_s: float


class RunCache:
    """Made and used within the event loop."""

    def __init__(
        self, book: RunManager, reading: DocumentCache, clock: Callable[[], float] = time.monotonic
    ) -> None:
        self._book, self._reading, self._clock = book, reading, clock
        self._kept: RunSnapshot | None = None

    async def __call__(self, run_id: str) -> RunSnapshot:
        """Return the current state of the run.

        The errors are those of `RunManager.document`.
        """
        kept = self._kept
        if (
            kept is not None
            and kept.run_id == run_id
            and kept.changes is not None
            and kept.changes == self._book.changes(run_id)
            and self._clock() - kept.at_s < KEPT_S
        ):
            return kept
        return await self.anew(run_id)

    async def anew(self, run_id: str) -> RunSnapshot:
        """Return the state of the run, read after this call.

        The errors are those of `RunManager.document`.
        """
        glance = await self._reading(f"a glance at run {run_id}", lambda: self._read(run_id))
        self._kept = glance
        return glance

    def _read(self, run_id: str) -> RunSnapshot:
        at_s, changes = self._clock(), self._book.changes(run_id)  # before: what comes meanwhile makes it old
        document = self._book.document(run_id)
        still = document["state"] in FINAL or document["dry_run"]
        body = RunResponse.model_validate(document).model_dump_json(by_alias=True).encode()
        return RunSnapshot(run_id, document["version"], still, body, changes, at_s)
