"""The motion lease: one holder at a time, who says again and again that somebody is there.

A program that dies, or whose network does, falls silent; then the robot is stopped. Stopping needs no lease.
Expiry is counted on the monotonic clock, so a jump of the calendar neither ends nor prolongs it.
"""

from __future__ import annotations

import secrets
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

from service.http.problems import Problem


@dataclass(frozen=True)
class Held:
    """A lease as it was given. `seconds`: until it expires, unless the POST is repeated."""

    id: str
    holder: str
    seconds: float
    ends: float  # monotonic
    expires_utc: float

    @property
    def live(self) -> bool:
        return time.monotonic() < self.ends


class Lease:
    """Thread-safe. `lost` is called, in the watching thread, with the holder who fell silent."""

    def __init__(self, lost: Callable[[str], None]) -> None:
        self._lost = lost
        self._changed = threading.Condition()
        self._held: Held | None = None
        self._closed = False
        self._watcher = threading.Thread(target=self._watch, name="lease", daemon=True)
        self._watcher.start()

    def take(self, holder: str, seconds: float, lease_id: str) -> Held:
        """Take it, or prolong one's own. Raises Problem 409 while another holds it."""
        with self._changed:
            held = self._live()
            if held is not None and held.holder != holder:
                raise self._other(held)
            self._check_id(held, lease_id)
            self._held = Held(
                id=secrets.token_hex(8) if held is None else held.id,
                holder=holder,
                seconds=seconds,
                ends=time.monotonic() + seconds,
                expires_utc=time.time() + seconds,
            )
            self._changed.notify_all()
            return self._held

    def give_back(self, lease_id: str) -> str | None:
        """Who held it. Raises Problem 409 when the id is of another lease."""
        with self._changed:
            held = self._live()
            self._check_id(held, lease_id)
            self._held = None
            self._changed.notify_all()
            return None if held is None else held.holder

    def needed(self, lease_id: str) -> str:
        """The holder on whose behalf the robot may move. Raises Problem 409 where there is none."""
        with self._changed:
            held = self._live()
            if held is None:
                raise Problem(
                    409,
                    "Nobody holds the motion lease, so nothing may move.",
                    "Take it with POST /api/v1/cell/lease and repeat that before it expires.",
                    code=8101,
                )
            self._check_id(held, lease_id)
            return held.holder

    @property
    def current(self) -> Held | None:
        """The live lease."""
        with self._changed:
            return self._live()

    def close(self) -> None:
        """End the watching; nobody is told."""
        with self._changed:
            self._held, self._closed = None, True
            self._changed.notify_all()
        self._watcher.join()

    def _live(self) -> Held | None:
        return self._held if self._held is not None and self._held.live else None

    def _check_id(self, held: Held | None, lease_id: str) -> None:
        if held is not None and lease_id and lease_id != held.id:
            raise self._other(held)

    def _other(self, held: Held) -> Problem:
        return Problem(
            409,
            f"The motion lease is held by {held.holder}.",
            f"Ask {held.holder} to give it back, or wait until it expires.",
            code=8102,
            holder=held.holder,
            retry_after_s=round(max(0.0, held.ends - time.monotonic()), 1),
        )

    def _watch(self) -> None:
        while True:
            with self._changed:
                if self._closed:
                    return
                left = None if self._held is None else self._held.ends - time.monotonic()
                if left is None or left > 0.0:
                    self._changed.wait(left)
                    continue
                assert self._held is not None
                silent, self._held = self._held.holder, None
            self._lost(silent)
