"""The motion lease, held by one client at a time, which renews it to show its presence.

Its `lease_id` is a secret of the holder. It is given once, in the answer that grants the lease, and is kept
only in memory. A client that moves the robot, prolongs the lease or gives it back has to send it. A name proves
nothing: it is in every refusal. Another person may take the lease over, with a reason. That is a deliberate act
and is noted.

A program that dies, or loses its network, falls silent. Then the robot comes to rest and the run is paused. The
next holder of the lease can resume it. `acquisition.run.orders.lease` watches the lease while devices are in
use. Stopping needs no lease. Expiry is counted on the steady clock, so a jump of the calendar neither ends nor
prolongs it.
"""

from __future__ import annotations

import hmac
import secrets
import threading
from dataclasses import dataclass, field, replace

import acquisition
from acquisition import Clock, ScaledClock
from service.http.access.audit import Audit
from service.http.wire.paths import path_of
from service.http.wire.problems import Problem

LEASE = path_of("cell", "lease")


@dataclass(frozen=True)
class HeldLease:
    """A granted lease.

    A run watches `beats`. `origin` says from whom the lease was taken over, and why.
    """

    secret: str = field(repr=False)
    beats: acquisition.LeaseDeadline
    expires_utc: float
    origin: str = ""

    @property
    def holder(self) -> str:
        return self.beats.owner

    @property
    def live(self) -> bool:
        return self.beats.left_s > 0.0

    def proved_by(self, lease_id: str) -> bool:
        """Return whether `lease_id` is the secret of the lease, compared in constant time."""
        return hmac.compare_digest(lease_id.encode(), self.secret.encode())


class MotionLease:
    """The motion lease of a service. Thread-safe.

    Of the two locks, `_noting` is held while the audit is written, `_mutex` only for moments. Prolonging a lease
    needs only `_mutex`, so that it can be done within the event loop.
    """

    def __init__(self, audit: Audit, clock: Clock | None = None) -> None:
        self._audit = audit
        self._clock = clock or ScaledClock()
        self._noting = threading.Lock()
        self._mutex = threading.Lock()
        self._held: HeldLease | None = None

    def grant(self, holder: str, seconds: float) -> HeldLease:
        """Take the lease if it is free.

        Raises
        ------
        Problem
            409: the lease is held.
        StorageError
            The audit cannot be written.
        """
        with self._noting:
            if (held := self._live()) is not None:
                raise _other(held)
            return self._new(holder, seconds, "granted")

    def renew(self, holder: str, seconds: float, lease_id: str) -> HeldLease:
        """Prolong the holder's lease.

        A lease that has ended is not granted again. Its holder has to learn that the robot has come to rest. A
        request that was under way when the lease was given back must not take it again.

        Raises
        ------
        Problem
            409: the lease has expired, or belongs to another client.
        """
        with self._mutex:
            held = self._live()
            if held is None:
                raise Problem(
                    409,
                    "The lease of this Lease-Id has ended, and no client holds the motion lease now.",
                    f"Take it again with POST {LEASE} without Lease-Id, and resume what was paused.",
                    code=8112,
                )
            _prove(held, lease_id)
            if held.holder != holder:
                raise _other(held)
            held.beats.beat(seconds)
            self._held = replace(held, expires_utc=self._clock.utc() + seconds)
            return self._held

    def take_over(self, holder: str, seconds: float, reason: str) -> tuple[HeldLease, str]:
        """Take the lease from any holder.

        Returns the lease and the name of the former holder, empty if there was none. The caller must pause motion by
        the old lease.

        Raises
        ------
        StorageError
            The audit cannot be written.
        """
        with self._noting:
            held = self._live()
            before = "" if held is None else held.holder
            origin = f", who has taken it over from {before} ({reason})" if before else ""
            return self._new(holder, seconds, "taken over", origin, before=before, reason=reason), before

    def give_back(self, lease_id: str) -> str | None:
        """End the lease and return its holder, None without one.

        Raises
        ------
        Problem
            409: this is not the secret of the lease.
        """
        with self._mutex:
            held = self._live()
            if held is not None:
                _prove(held, lease_id)
            self._held = None
            return None if held is None else held.holder

    def needed(self, lease_id: str) -> HeldLease:
        """Return the lease by which the robot may move.

        Raises
        ------
        Problem
            409: there is no lease, or it belongs to another client.
        """
        with self._mutex:
            held = self._live()
            if held is None:
                raise Problem(
                    409,
                    "No client holds the motion lease, so nothing may move.",
                    f"Take it with POST {LEASE}, send its lease_id as Lease-Id, and prolong it in time.",
                    code=8101,
                )
            _prove(held, lease_id)
            return held

    @property
    def current(self) -> HeldLease | None:
        """The live lease."""
        return self._live()

    def _live(self) -> HeldLease | None:
        held = self._held
        return held if held is not None and held.live else None

    def _new(self, holder: str, seconds: float, how: str, origin: str = "", **more: str) -> HeldLease:
        # Before it takes effect: what cannot be noted does not happen.
        self._audit.note(f"lease {how}", holder=holder, seconds=seconds, **more)
        beats = acquisition.LeaseDeadline(holder, seconds, self._clock)
        new = HeldLease(secrets.token_urlsafe(24), beats, self._clock.utc() + seconds, origin)
        with self._mutex:
            self._held = new
        return new


def _prove(held: HeldLease, lease_id: str) -> None:
    if not held.proved_by(lease_id):
        raise _other(held, f"; this request has {'another' if lease_id else 'no'} Lease-Id")


def _other(held: HeldLease, more: str = "") -> Problem:
    return Problem(
        409,
        f"The motion lease is held by {held.holder}{held.origin}{more}.",
        f"The holder sends its lease_id as Lease-Id. Others ask {held.holder} to give it back, wait until it "
        f"expires, or take it over with a reason (POST {LEASE}/takeover).",
        code=8102,
        holder=held.holder,
        retry_after_s=round(max(0.0, held.beats.left_s), 1),
    )
