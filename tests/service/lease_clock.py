"""A clock for leases that advances only when a test advances it.

A lapse then takes no time in a test and comes exactly when it is due.
"""

from __future__ import annotations

import threading

from tests.drivers.waiting import PATIENCE_S


class LeaseClock:
    """Seconds. Who waits is woken by `pass_by`, and looks at the time."""

    time_scale = 1.0

    def __init__(self) -> None:
        self._changed = threading.Condition()
        self._now = 0.0
        self._waiting: list[threading.Event] = []

    def now(self) -> float:
        with self._changed:
            return self._now

    def utc(self) -> float:
        return 1_700_000_000.0 + self.now()

    def wait(self, seconds: float, wake: threading.Event) -> bool:
        with self._changed:
            self._waiting.append(wake)
            self._changed.notify_all()
        wake.wait()
        with self._changed:
            self._waiting.remove(wake)
        return True

    def pass_by(self, seconds: float) -> None:
        """Advance the clock by some seconds, as soon as a thread waits for it."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._waiting, PATIENCE_S), "nobody waits"
            self._now += seconds
            for wake in self._waiting:
                wake.set()
