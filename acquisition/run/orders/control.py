"""The orders of people and watchdogs to a running campaign, from any thread.

pause          after the current reading, for which the robot may still have to go to its pose
rest           pause, and begin no other motion: the current one ends by itself
stop           the order goes to the robot at once, over a separate connection, in any state of the sequencer
new station    the instrument is moved: nests before poses
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from acquisition.run.clock import Clock

ON_REQUEST, STOPPED = "Paused on request.", "Stopped on request."


class Pausing(Exception):
    """Exception that unwinds the sequencer to a pause; its text is the reason."""


class Stopping(Exception):
    """Exception that unwinds the sequencer to its end."""


class Control:
    """The orders, and the waits that they end."""

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
        """Whether a pause or a stop was requested."""
        return self._any.is_set()

    def watch(self, watcher: Callable[[], None]) -> None:
        """Call `watcher` on every order; it must not block."""
        self._watchers.append(watcher)

    def pause(self, reason: str = ON_REQUEST) -> None:
        """Pause after the current reading. The first reason counts."""
        if not self._any.is_set():
            self._reason = reason
        self._any.set()
        self._notify()

    def rest(self, reason: str) -> None:
        """End the current move and begin nothing more, because no one is responsible for the robot."""
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
        """Order that the nests are measured before the next pose, because the instrument is moved."""
        with self._mutex:
            self._station = reason

    def take_new_station(self) -> str | None:
        """Return the reason to measure the nests now, and forget it; None if there is none."""
        with self._mutex:
            reason, self._station = self._station, None
            return reason

    def _notify(self) -> None:
        for watcher in tuple(self._watchers):
            watcher()

    def check(self) -> None:
        """Check whether the run must end.

        Raises
        ------
        Stopping
            A stop was requested.
        Pausing
            A pause was requested.
        """
        self.check_stop()
        if self._any.is_set():
            raise Pausing(self._reason)

    def check_stop(self) -> None:
        """Check for a stop, before and after every act of a device.

        Raises
        ------
        Stopping
            A stop was requested.
        Pausing
            The robot must come to rest.
        """
        if self._stop.is_set():
            raise Stopping
        if self._now.is_set():
            raise Pausing(self._reason)

    def wait(self, seconds: float) -> None:
        """Wait for `seconds` of campaign time.

        Raises
        ------
        Stopping
            A stop was requested meanwhile.
        Pausing
            A pause was requested meanwhile.
        """
        self._clock.wait(seconds, self._any)
        self.check()

    def settle(self, seconds: float) -> None:
        """Wait for `seconds` of campaign time with the robot at rest; a pause waits for the reading.

        Errors are those of `check_stop`.
        """
        self._clock.wait(seconds, self._now)
        self.check_stop()
