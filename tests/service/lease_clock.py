"""A clock for leases that only goes when it is told to: a lapse in a test takes no time and comes when it is due."""

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
        """So many seconds pass, once somebody waits for them."""
        with self._changed:
            assert self._changed.wait_for(lambda: self._waiting, PATIENCE_S), "nobody waits"
            self._now += seconds
            for wake in self._waiting:
                wake.set()
