"""The staircase: a check that is well within what is permitted lengthens the interval, one outside shortens it.

Within 80 % of the permitted error, U included: longer; within it: as it was; beyond: shorter. How much shorter follows
from how often checks shall pass: with l = `longer` and s the factor of a failure, the interval neither grows nor
shrinks where a share R of the checks passes,

    l^R s^(1 - R) = 1.

A check that came before the interval was over says little about the whole of it: it lengthens at most to l times the
time that has passed.

Sources: ILAC-G24:2022 / OIML D 10:2022, 6.2 (automatic adjustment, 80 %); NCSLI RP-1, method A1 (the two factors).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from calib.errors import DataError
from calib.upkeep.check import Step, Unit

WITHIN = 0.8
"""Share of the permitted error within which a check lengthens the interval."""


@dataclass(frozen=True)
class Staircase:
    """first: interval before anything is known; permitted: largest error from `target`, in the unit of the values;
    longer: factor of a good check; reliability: share of checks that shall pass; shortest, longest: intervals.

    Intervals are days, or hours of use inside `InUse`. Raises DataError for values that make no staircase.
    """

    first: float
    permitted: float
    target: float = 0.0
    longer: float = 1.1
    reliability: float = 0.9
    shortest: float = 7.0
    longest: float = 1825.0

    def __post_init__(self) -> None:
        refuse_intervals(self.first, self.shortest, self.longest)
        refuse_permitted(self.permitted)
        if not self.longer > 1.0:
            raise DataError(f"is {self.longer:g}.", do="Give a factor above 1.", key="longer")
        if not 0.0 < self.reliability < 1.0:
            raise DataError(
                f"is {self.reliability:g}.", do="Give a share between 0 and 1.", key="reliability"
            )

    @property
    def shorter(self) -> float:
        """Factor of a check that failed."""
        return self.longer ** (-self.reliability / (1.0 - self.reliability))

    def interval(self, steps: Sequence[Step], unit: Unit) -> tuple[float, str]:
        """Interval after the last of some steps, oldest first, and why, without an end."""
        interval, why = self.first, ""
        for before, step in zip([None, *steps], steps, strict=False):
            off = abs(step.value - self.target)
            was = interval
            told = f"the last check found {off:.3g} (U {step.u:.2g}) of {self.permitted:g} permitted"
            if off > self.permitted:
                interval = max(interval * self.shorter, self.shortest)
                why = f"{told}: too much, so the interval is {unit.of(interval)} instead of {was:.0f}"
            elif off + step.u <= WITHIN * self.permitted and before is not None:
                grown = self.longer * min(interval, step.x - before.x)
                interval = min(max(interval, grown), self.longest)
                why = f"{told}, within {WITHIN:.0%}: the interval is {unit.of(interval)} after {was:.0f}"
            else:
                why = f"{told}: the interval stays {unit.of(interval)}"
        return interval, why


def refuse_intervals(first: float, shortest: float, longest: float) -> None:
    """Raise DataError where a first interval does not lie between a shortest above zero and a longest."""
    if not 0.0 < shortest <= first <= longest:
        raise DataError(
            f"is {first:g}, the shortest {shortest:g}, the longest {longest:g}.",
            do="Give 0 < shortest <= first <= longest.",
            key="first",
        )


def refuse_permitted(permitted: float) -> None:
    """Raise DataError for a permitted error that is none."""
    if not permitted > 0.0:
        raise DataError(
            f"is {permitted:g}.", do="Give the largest error permitted, above 0.", key="permitted"
        )
