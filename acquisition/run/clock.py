"""The clock of a campaign, which runs faster than real time on a simulated cell.

It is injected everywhere, so that a settle time costs nothing in a test and a drift has its right size in a rehearsal.
Times in s.
"""

from __future__ import annotations

import threading
import time
from typing import Protocol


class Clock(Protocol):
    """Campaign time.

    `now` never goes back; `utc` is the calendar, which may jump and is only recorded.
    """

    @property
    def time_scale(self) -> float: ...
    def now(self) -> float: ...
    def utc(self) -> float: ...
    def wait(self, seconds: float, wake: threading.Event) -> bool: ...


class ScaledClock:
    """Real time, `time_scale` times as fast; 1 on a real cell."""

    def __init__(self, time_scale: float = 1.0) -> None:
        self._time_scale = time_scale
        self._start = time.monotonic()

    @property
    def time_scale(self) -> float:
        """Campaign seconds per real second."""
        return self._time_scale

    def now(self) -> float:
        """Return the campaign seconds since this clock was created."""
        return (time.monotonic() - self._start) * self._time_scale

    def utc(self) -> float:
        """Return the seconds since 1970, UTC."""
        return time.time()

    def wait(self, seconds: float, wake: threading.Event) -> bool:
        """Wait for `seconds` of campaign time; True if `wake` was set before they passed."""
        return wake.wait(max(0.0, seconds) / self._time_scale)
