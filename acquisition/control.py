"""What people and watchdogs may ask of a running campaign, from any thread: to pause, or to stop now.

Pausing waits for the reading in hand. Stopping tells the robot at once, over its own connection, and never
depends on anything that the sequencer is waiting for.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from acquisition.clock import Clock

ON_REQUEST = "Paused on request."


class Pausing(Exception):
    """Unwinds the sequencer to a pause; its text is the reason."""


class Stopping(Exception):
    """Unwinds the sequencer to its end."""


class Control:
    """The two orders, and waits that they end."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._stop = threading.Event()
        self._any = threading.Event()
        self._reason = ON_REQUEST
        self._watchers: list[Callable[[], None]] = []

    @property
    def stopping(self) -> bool:
        return self._stop.is_set()

    @property
    def asked(self) -> bool:
        """Pause or stop was asked for."""
        return self._any.is_set()

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call `watcher` on every order; it must not block."""
        self._watchers.append(watcher)

    def pause(self, reason: str = ON_REQUEST) -> None:
        """After the reading in hand. The first reason counts."""
        if not self._any.is_set():
            self._reason = reason
        self._any.set()
        self._tell()

    def stop(self) -> None:
        self._stop.set()
        self._any.set()
        self._tell()

    def _tell(self) -> None:
        for watcher in tuple(self._watchers):
            watcher()

    def check(self) -> None:
        """Raises Stopping or Pausing."""
        self.check_stop()
        if self._any.is_set():
            raise Pausing(self._reason)

    def check_stop(self) -> None:
        """Raises Stopping."""
        if self._stop.is_set():
            raise Stopping

    def wait(self, seconds: float) -> None:
        """Campaign seconds. Raises Stopping or Pausing when asked meanwhile."""
        self._clock.wait(seconds, self._any)
        self.check()

    def settle(self, seconds: float) -> None:
        """Campaign seconds with the robot standing; a pause waits for the reading. Raises Stopping."""
        self._clock.wait(seconds, self._stop)
        self.check_stop()
