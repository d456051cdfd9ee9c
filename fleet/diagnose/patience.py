"""The patience of a call with a store that is away: it asks again, with one data set at a time, and then gives up.

A database that is restarted or out of reach for an hour shall not end the work of a night.
"""

from __future__ import annotations

import time
from collections.abc import Callable

from fleet.errors import StoreGone

STORE_S = 3600.0
FIRST_S, MOST_S = 1.0, 30.0  # between two questions: twice as long each time


class Patience:
    """The waiting of one call. tell: called when the store goes and comes back; clock: seconds."""

    def __init__(self, tell: Callable[[str], None], clock: Callable[[], float] = time.monotonic) -> None:
        self._tell, self._clock = tell, clock
        self._since: float | None = None
        self._pause_s, self._next = FIRST_S, 0.0

    @property
    def away(self) -> bool:
        """Whether the store did not answer when it was last asked."""
        return self._since is not None

    def refused(self, error: StoreGone) -> None:
        """The store is away. Raises the error where it has been away for too long."""
        now = self._clock()
        if self._since is None:
            self._since, self._pause_s = now, FIRST_S
            self._tell(
                f"{error} Nothing that is done is lost; it is asked again for {STORE_S / 60:.0f} min, "
                "Ctrl-C ends the waiting"
            )
        elif now - self._since > STORE_S:
            raise error
        else:
            self._pause_s = min(2.0 * self._pause_s, MOST_S)
        self._next = now + self._pause_s

    def worth_asking(self) -> bool:
        """Whether it is time to ask again."""
        return self._clock() >= self._next

    def answered(self) -> None:
        """The store has answered."""
        if self._since is not None:
            self._tell(f"the store answers again, after {self._clock() - self._since:.0f} s")
            self._since = None
