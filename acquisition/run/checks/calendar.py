"""The calendar compared with the steady clock.

A step means that the computer slept or its clock was set.
"""

from __future__ import annotations

from acquisition.errors import ClockJumped
from acquisition.run.clock import Clock

# A clock that is being disciplined slews by 500 ppm at most; a step beyond twice that has another cause.
STEP_S, SLEW = 5.0, 1e-3


class Calendar:
    """The calendar of one execution."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        self._looked: tuple[float, float] | None = None  # calendar and steady clock, s on the wall

    def look(self) -> None:
        """Compare both clocks.

        Raises
        ------
        ClockJumped
            The calendar stepped since the last comparison.
        """
        calendar, steady = self._clock.utc(), self._clock.now() / self._clock.time_scale
        before, self._looked = self._looked or (calendar, steady), (calendar, steady)
        passed = steady - before[1]
        step = calendar - before[0] - passed
        if abs(step) > STEP_S + SLEW * passed:
            raise ClockJumped(f"the clock of the computer stepped by {step:+.0f} s")
