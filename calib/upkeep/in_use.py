"""Intervals in hours of use: a robot that is not used does not wear.

Any method whose intervals are then hours; the date follows from how much the robot was used lately. A longest time in
days stays, since feet settle and tools are bumped by the calendar too.

Source: ILAC-G24:2022 / OIML D 10:2022, 6.4 ("in-use" time).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from calib.errors import DataError
from calib.upkeep.check import HOURS, Check, Step
from calib.upkeep.drift import Drift
from calib.upkeep.staircase import Staircase


@dataclass(frozen=True)
class InUse:
    """by: the method, its intervals in hours of use; hours_a_day: use assumed until two readings of the counter show
    it; longest_days: whatever the use. Raises DataError for values out of range."""

    by: Staircase | Drift
    hours_a_day: float = 16.0
    longest_days: float = 730.0

    def __post_init__(self) -> None:
        if not 0.0 < self.hours_a_day <= 24.0:
            raise DataError(
                f"is {self.hours_a_day:g}.", do="Give hours above 0, up to 24.", key="hours_a_day"
            )
        if not self.longest_days > 0.0:
            raise DataError(f"is {self.longest_days:g}.", do="Give days above 0.", key="longest_days")

    def days(self, history: Sequence[Check]) -> tuple[float, str]:
        """Days after the last of some checks, oldest first, and why, without an end. Raises DataError where the counter
        was not read at a check, or runs backwards."""
        hours = []
        for check in history:
            if check.used_h is None:
                raise DataError(
                    f"The hours of use at the check of {check.at:%Y-%m-%d %H:%M} UTC are not known.",
                    do="Read the robot's counter once before and once after every check, or go by the calendar.",
                )
            hours.append(check.used_h)
        if any(later < earlier for earlier, later in pairwise(hours)):
            raise DataError(
                "runs backwards: the counter was set to zero, or this is another robot.",
                do="Begin a new history.",
                key="used_h",
            )
        steps = [Step(h, check.value, check.u) for h, check in zip(hours, history, strict=True)]
        interval, why = self.by.interval(steps, HOURS)
        a_day, since = self._a_day(history, hours)
        days = interval / a_day if a_day > 0.0 else self.longest_days
        why += f"; at {a_day:.3g} hours a day{since} that is {days:.0f} days"
        if days >= self.longest_days:
            return self.longest_days, f"{why}, and {self.longest_days:.0f} days is the longest"
        return days, why

    def _a_day(self, history: Sequence[Check], hours: Sequence[float]) -> tuple[float, str]:
        """Use since the last check but one that is a day earlier or more; and since when, in words."""
        for check, then in zip(history[-2::-1], hours[-2::-1], strict=True):
            days = (history[-1].at - check.at).total_seconds() / 86400.0
            if days >= 1.0:
                return (hours[-1] - then) / days, f" since {check.at:%Y-%m-%d}"
        return self.hours_a_day, " (assumed)"
