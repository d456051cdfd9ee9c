"""The motion lease: one holder at a time, who says again and again that somebody is there.

A program that dies, or whose network does, falls silent; then the robot comes to rest and the run is paused, to be
resumed by whoever takes the lease next. Who watches is `acquisition.lease`, for as long as devices are in use.
Stopping needs no lease. Expiry is counted on the steady clock, so a jump of the calendar neither ends nor prolongs
it.
"""

from __future__ import annotations

import secrets
import threading
from dataclasses import dataclass

import acquisition
from acquisition import Clock, ScaledClock
from service.http.problems import Problem


@dataclass(frozen=True)
class Held:
    """A lease as it was given. `beats`: what a run watches; it ends unless the POST is repeated."""

    id: str
    beats: acquisition.Lease
    expires_utc: float

    @property
    def holder(self) -> str:
        return self.beats.owner

    @property
    def live(self) -> bool:
        return self.beats.left_s > 0.0


class Lease:
    """Thread-safe."""

    def __init__(self, clock: Clock | None = None) -> None:
        self._clock = clock or ScaledClock()
        self._mutex = threading.Lock()
        self._held: Held | None = None

    def take(self, holder: str, seconds: float, lease_id: str) -> Held:
        """Take it, or prolong one's own. Raises Problem 409 while another holds it."""
        with self._mutex:
            held = self._live()
            if held is not None and held.holder != holder:
                raise _other(held)
            _check_id(held, lease_id)
            if held is None:
                own, beats = secrets.token_hex(8), acquisition.Lease(holder, seconds, self._clock)
            else:
                own, beats = held.id, held.beats
                beats.beat(seconds)
            self._held = Held(own, beats, self._clock.utc() + seconds)
            return self._held

    def give_back(self, lease_id: str) -> str | None:
        """Who held it. Raises Problem 409 when the id is of another lease."""
        with self._mutex:
            held = self._live()
            _check_id(held, lease_id)
            self._held = None
            return None if held is None else held.holder

    def needed(self, lease_id: str) -> Held:
        """The lease by which the robot may move. Raises Problem 409 where there is none."""
        with self._mutex:
            held = self._live()
            if held is None:
                raise Problem(
                    409,
                    "Nobody holds the motion lease, so nothing may move.",
                    "Take it with POST /api/v1/cell/lease and repeat that before it expires.",
                    code=8101,
                )
            _check_id(held, lease_id)
            return held

    @property
    def current(self) -> Held | None:
        """The live lease."""
        with self._mutex:
            return self._live()

    def _live(self) -> Held | None:
        return self._held if self._held is not None and self._held.live else None


def _check_id(held: Held | None, lease_id: str) -> None:
    if held is not None and lease_id and lease_id != held.id:
        raise _other(held)


def _other(held: Held) -> Problem:
    return Problem(
        409,
        f"The motion lease is held by {held.holder}.",
        f"Ask {held.holder} to give it back, or wait until it expires.",
        code=8102,
        holder=held.holder,
        retry_after_s=round(max(0.0, held.beats.left_s), 1),
    )
