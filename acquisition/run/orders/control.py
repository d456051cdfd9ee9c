"""The orders that people and watchdogs may give to a running campaign, from any thread.

pause          after the reading in hand, for which the robot may still have to go to its pose
rest           pause, and begin no other motion: what is under way ends by itself
stop           the order goes to the robot at once, over its own connection, whatever the sequencer is waiting for
new station    the instrument is moved: nests before poses
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from acquisition.run.clock import Clock

ON_REQUEST = "Paused on request."


class Pausing(Exception):
    """Unwinds the sequencer to a pause; its text is the reason."""


class Stopping(Exception):
    """The order that unwinds the sequencer to its end."""


class Control:
    """The orders, and waits that they end."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._stop = threading.Event()
        self._now = threading.Event()  # rest or stop
        self._any = threading.Event()
        self._reason = ON_REQUEST
        self._mutex = threading.Lock()
        self._station: str | None = None
        self._watchers: list[Callable[[], None]] = []

    @property
    def stopping(self) -> bool:
        return self._stop.is_set()

    @property
    def asked(self) -> bool:
        """Whether a pause or a stop was asked for."""
        return self._any.is_set()

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call `watcher` on every order; it must not block."""
        self._watchers.append(watcher)

    def pause(self, reason: str = ON_REQUEST) -> None:
        """Pause after the reading in hand. The first reason counts."""
        if not self._any.is_set():
            self._reason = reason
        self._any.set()
        self._notify()

    def rest(self, reason: str) -> None:
        """Nobody is responsible for the robot any more: the current move ends, and nothing else begins."""
        if not self._any.is_set():
            self._reason = reason
        self._now.set()
        self._any.set()
        self._notify()

    def stop(self) -> None:
        self._stop.set()
        self._now.set()
        self._any.set()
        self._notify()

    def new_station(self, reason: str) -> None:
        """The instrument is moved: before the next pose its nests are to be measured."""
        with self._mutex:
            self._station = reason

    def take_new_station(self) -> str | None:
        """The reason to measure the nests now, which is forgotten with this call; None where there is none."""
        with self._mutex:
            reason, self._station = self._station, None
            return reason

    def _notify(self) -> None:
        for watcher in tuple(self._watchers):
            watcher()

    def check(self) -> None:
        """Check whether the run is to end. Raises Stopping or Pausing."""
        self.check_stop()
        if self._any.is_set():
            raise Pausing(self._reason)

    def check_stop(self) -> None:
        """Look for a stop, before and after every act of a device. Raises Stopping, and Pausing to come to rest."""
        if self._stop.is_set():
            raise Stopping
        if self._now.is_set():
            raise Pausing(self._reason)

    def wait(self, seconds: float) -> None:
        """Campaign seconds. Raises Stopping or Pausing when asked meanwhile."""
        self._clock.wait(seconds, self._any)
        self.check()

    def settle(self, seconds: float) -> None:
        """Campaign seconds with the robot at rest; a pause waits for the reading. Raises as `check_stop`."""
        self._clock.wait(seconds, self._now)
        self.check_stop()
