"""Feed of live values.

It follows the run that uses the robot, and hands each change to the publishers. The values are those of HTTP, as JSON:
`state` is the answer to `getRun`, `event` an `EventShown` of the same stream as `streamEvents`, `result` the answer to
`getResult`. The others are members of `state`. Publishers take a value and return at once, so that none of them can
delay a run or a stop.
"""

from __future__ import annotations

import asyncio
import json
import logging
import time
from collections.abc import Sequence
from contextlib import aclosing, suppress
from typing import Any

from service.http.access.roles import LivePublisher
from service.http.runs.run_document import event_document
from service.http.state import Service
from service.http.wire.problems import Problem
from service.job_folder import RESULT
from service.refusals import REFUSALS

TICK_S = 1.0
"""Until another run, or another answer of a run at rest, is noticed."""

PROGRESS = ("done", "total", "skipped", "seconds_left")
_RESULTS = ("diagnoses", "loops", "verifications")
_log = logging.getLogger("service.live")


class LiveFeed:
    """The feed of one service; `follow` runs within the event loop of the service."""

    def __init__(self, here: Service, publishers: Sequence[LivePublisher]) -> None:
        self._here, self._publishers = here, publishers
        self._begun_utc = time.time()
        self._last: dict[str, bytes] = {}
        self._seen: dict[str, int] = {}  # id of the last event that was handed on, by run
        self._ends = -1
        self._trouble = ""

    async def follow(self) -> None:
        """Hand on what changes until the service ends."""
        while not self._here.closing:
            try:
                await self._turn()
            except (Problem, *REFUSALS, OSError) as error:  # a run that is deleted, a full disk
                if str(error) != self._trouble:
                    _log.warning("Live values are incomplete: %s", error)
                self._trouble = str(error)
            await asyncio.sleep(TICK_S)

    async def _turn(self) -> None:
        here, first = self._here, self._ends < 0
        await self._offer_result()
        busy = here.book.busy_with
        run_id = busy or here.book.last
        if run_id is None:
            return
        version = await self._offer_run(run_id)
        if first and busy is None:  # its events are older than this service
            self._seen[run_id] = version
        if busy is None and version <= self._seen.get(run_id, -1):
            return
        run = await here.waiting(lambda: here.book.get(run_id))
        if run_id not in self._seen:
            begun = await here.waiting(lambda: run.events(0, 1))
            new = bool(begun) and begun[0].utc >= self._begun_utc
            self._seen[run_id] = 0 if new else version
        async with aclosing(here.event_batches(run_id, run, self._seen[run_id], TICK_S)) as batches:
            async for events in batches:
                for event in events:
                    self._hand_on("event", _json(event_document(event)), retained=False)
                    self._seen[run_id] = event.id
                await self._offer_run(run_id)
                await self._offer_result()
                if not events and here.book.busy_with != run_id:
                    return

    async def _offer_result(self) -> None:
        if self._here.ends != self._ends:
            self._ends = self._here.ends
            self._offer("result", _json(await self._here.reading("the last result", self._last_result)))

    async def _offer_run(self, run_id: str) -> int:
        """Hand on a run if it has changed, and return its version."""
        glance = await self._here.glances(run_id)
        if glance.body != self._last.get("state"):
            self._offer("state", glance.body)
            run = json.loads(glance.body)
            self._offer("progress", _json({key: run[key] for key in PROGRESS}))
            self._offer("prompt", _json(run["prompt"]))
            self._offer("reading", _json(run["last_reading"]))
        return glance.version

    def _offer(self, topic: str, payload: bytes) -> None:
        if self._last.get(topic) != payload:
            self._last[topic] = payload
            self._hand_on(topic, payload, retained=True)

    def _hand_on(self, topic: str, payload: bytes, *, retained: bool) -> None:
        for each in self._publishers:
            each.offer(topic, payload, retained=retained)

    def _last_result(self) -> dict[str, Any] | None:
        """Return the diagnosis, loop or verification that ended last; None if there is none."""
        ended: list[tuple[float, str]] = []
        for kind in _RESULTS:
            for file in (self._here.settings.record / kind).glob(f"*/{RESULT}"):
                with suppress(OSError):  # it is being deleted
                    ended.append((file.stat().st_mtime, file.parent.name))
        return self._here.result(max(ended)[1]) if ended else None


def _json(document: Any) -> bytes:
    return json.dumps(document, ensure_ascii=False, separators=(",", ":")).encode()
