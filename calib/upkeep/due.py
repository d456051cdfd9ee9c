"""Date of the next check, and its reason.

**In use.** Intervals may be in hours of use: a robot that is not used does not wear. Any method may count its
intervals in hours. The date then follows from the recent use of the robot. A longest time in days remains, since feet
settle and tools are bumped regardless of use.
Source: ILAC-G24:2022 / OIML D 10:2022, 6.4 ("in-use" time).

**Control chart.** The next check is due before drift and scatter together reach the permitted error.
A straight line through the values, weighted by their uncertainty, predicts later ones:

    y(x) = a + b x,    u(x)^2 = [1 x] C [1 x]' + between^2,

with C the covariance of a and b, and between^2 the scatter of the values about the line beyond their own u. The check
is due at the x at which |y(x) - target| + 2 u(x) reaches the permitted error. That sum is convex in x and
therefore reached once. The line is that of a weighted least squares.
Source: ILAC-G24:2022 / OIML D 10:2022, 6.3 (drift and dispersion from the plot, the interval from both).

**Staircase.** A check that is well within the permitted error lengthens the interval, one outside shortens it.
Within 80 % of the permitted error, U included, the interval becomes longer. Within the permitted error it stays.
Beyond, it becomes shorter. The factor for shorter follows from the required share of passed checks. With l = `longer`
and s the factor of a failure, the interval neither grows nor shrinks if a share R of the checks passes,

    l^R s^(1 - R) = 1.

A check before the end of the interval says little about the whole of it: it lengthens the interval to at most l times
the time that has passed.
Sources: ILAC-G24:2022 / OIML D 10:2022, 6.2 (automatic adjustment, 80 %), and NCSLI RP-1, method A1 (the two factors).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from scipy.optimize import root_scalar

from calib.array import Array
from calib.errors import DataError
from calib.units import percent


@dataclass(frozen=True)
class Check:
    """Value found on a date, with its expanded uncertainty U (k = 2), from separate readings.

    Attributes
    ----------
    at : datetime
        Date and time with time zone.
    value, u : float
        Value and U, any unit.
    used_h : float or None
        Hours of use on the robot's counter; None if it was not read.

    Raises
    ------
    DataError
        The date has no time zone, a number is not finite, or U or the hours are negative.
    """

    at: datetime
    value: float
    u: float
    used_h: float | None = None

    def __post_init__(self) -> None:
        if self.at.tzinfo is None:
            raise DataError("is a date without a time zone.", do="Give it in UTC.", key="at")
        if not (np.isfinite(self.value) and np.isfinite(self.u) and self.u >= 0.0):
            raise DataError(
                f"is {self.value:g} with U {self.u:g}.", do="Give numbers, and a U of 0 or more.", key="value"
            )
        if self.used_h is not None and not (np.isfinite(self.used_h) and self.used_h >= 0.0):
            raise DataError(f"is {self.used_h:g} h.", do="Give hours of 0 or more.", key="used_h")


@dataclass(frozen=True)
class CheckStep:
    """Check on an axis for intervals: days since the first check, or hours of use."""

    x: float
    value: float
    u: float


class Unit(NamedTuple):
    """Unit in which intervals are counted, in the singular and the plural."""

    one: str
    many: str

    def of(self, interval: float) -> str:
        """Format an interval as text."""
        return f"{interval:.0f} {self.many}"


DAYS = Unit("day", "days")
HOURS = Unit("hour of use", "hours of use")


def in_order(history: Sequence[Check]) -> list[Check]:
    """Sort the checks, oldest first."""
    return sorted(history, key=lambda check: check.at)


def days_of(history: Sequence[Check]) -> list[CheckStep]:
    """Convert checks, oldest first, to days since the first."""
    first = history[0].at
    return [CheckStep((c.at - first).total_seconds() / 86400.0, c.value, c.u) for c in history]


WITHIN = 0.8
"""Share of the permitted error within which a check lengthens the interval."""


@dataclass(frozen=True)
class Staircase:
    """Method that lengthens the interval after a good check and shortens it after a failure.

    Intervals are in days, or in hours of use inside `InUse`.

    Attributes
    ----------
    first : float
        Interval before the first result.
    permitted : float
        Largest permitted error from `target`, in the unit of the values.
    longer : float
        Factor of a good check.
    reliability : float
        Required share of passed checks.
    shortest, longest : float
        Limits of the interval.

    Raises
    ------
    DataError
        A value is out of range.
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

    def interval(self, steps: Sequence[CheckStep], unit: Unit) -> tuple[float, str]:
        """Return the interval after the last of some steps, oldest first, and the reason.

        The reason is a sentence without its full stop.
        """
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
                why = f"{told}, within {percent(WITHIN)}: the interval is {unit.of(interval)} after {was:.0f}"
            else:
                why = f"{told}: the interval stays {unit.of(interval)}"
        return interval, why


def refuse_intervals(first: float, shortest: float, longest: float) -> None:
    """Refuse a first interval that is not between a positive shortest and a longest.

    Raises
    ------
    DataError
        The order 0 < shortest <= first <= longest is violated.
    """
    if not 0.0 < shortest <= first <= longest:
        raise DataError(
            f"is {first:g}, the shortest {shortest:g}, the longest {longest:g}.",
            do="Give 0 < shortest <= first <= longest.",
            key="first",
        )


def refuse_permitted(permitted: float) -> None:
    """Refuse a permitted error that is not above zero.

    Raises
    ------
    DataError
        It is not above zero.
    """
    if not permitted > 0.0:
        raise DataError(
            f"is {permitted:g}.", do="Give the largest error permitted, above 0.", key="permitted"
        )


@dataclass(frozen=True)
class DriftInterval:
    """Method that predicts when the drift of the value reaches the permitted error.

    Intervals are in days, or in hours of use inside `InUse`.

    Attributes
    ----------
    first : float
        Interval until two checks determine the drift.
    permitted : float
        Largest permitted error from `target`, in the unit of the values.
    shortest, longest : float
        Limits of the interval.

    Raises
    ------
    DataError
        A value is out of range.
    """

    first: float
    permitted: float
    target: float = 0.0
    shortest: float = 7.0
    longest: float = 1825.0

    def __post_init__(self) -> None:
        refuse_intervals(self.first, self.shortest, self.longest)
        refuse_permitted(self.permitted)

    def interval(self, steps: Sequence[CheckStep], unit: Unit) -> tuple[float, str]:
        """Return the interval after the last of some steps, oldest first, and the reason.

        The reason is a sentence without its full stop.

        Raises
        ------
        DataError
            A value has no U, and the scatter about the line does not show one, as with two values.
        """
        last = steps[-1]
        if len({step.x for step in steps}) < 2:
            return self.first, f"one check shows no drift: the interval is the first, {unit.of(self.first)}"
        x = np.array([step.x for step in steps]) - last.x
        line, covariance, between = _line(
            x, np.array([s.value for s in steps]), np.array([s.u / 2.0 for s in steps])
        )

        def room(ahead: float) -> float:
            at = np.array([1.0, ahead])
            u = np.sqrt(at @ covariance @ at + between)
            return self.permitted - abs(float(line @ at) - self.target) - 2.0 * float(u)

        told = f"the value drifts by {line[1]:+.2g} (U {2.0 * np.sqrt(covariance[1, 1]):.1g}) per {unit.one}"
        if room(0.0) <= 0.0:
            return (
                self.shortest,
                f"{told} and may be beyond the {self.permitted:g} permitted already: {unit.of(self.shortest)}",
            )
        if room(self.longest) > 0.0:
            return (
                self.longest,
                f"{told} and stays within the {self.permitted:g} permitted: the longest, {unit.of(self.longest)}",
            )
        reached = float(root_scalar(room, bracket=(0.0, self.longest)).root)
        interval = max(reached, self.shortest)
        return interval, (
            f"{told} and may reach the {self.permitted:g} permitted {unit.of(reached)} after the last check"
        )


def _line(x: Array, values: Array, u: Array) -> tuple[Array, Array, float]:
    """Fit a line (a, b) to values (n,) with standard uncertainties u (n,).

    Also returns its covariance, and the variance between values beyond u, from the residuals and their degrees of
    freedom.

    Raises
    ------
    DataError
        The variance of the values is unknown.
    """
    design = np.column_stack([np.ones_like(x), x])
    freedom = len(x) - 2
    left = values - design @ np.linalg.lstsq(design, values, rcond=None)[0]
    between = max(float(left @ left) / freedom - float(np.mean(u**2)), 0.0) if freedom else 0.0
    variance = between + u**2
    if np.any(variance <= 0.0):
        raise DataError(
            "is 0, and the uncertainty of the values is not stated elsewhere.", do="Give U.", key="u"
        )
    weighed = design / np.sqrt(variance)[:, None]
    covariance: Array = np.asarray(np.linalg.inv(weighed.T @ weighed), dtype=np.float64)
    return covariance @ weighed.T @ (values / np.sqrt(variance)), covariance, between


@dataclass(frozen=True)
class InUse:
    """Method whose intervals are in hours of use.

    Attributes
    ----------
    by : Staircase or DriftInterval
        Method, with its intervals in hours of use.
    hours_a_day : float
        Use per day that is assumed until two readings of the counter show it.
    longest_days : float
        Longest interval for any use.

    Raises
    ------
    DataError
        A value is out of range.
    """

    by: Staircase | DriftInterval
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
        """Return the days after the last of some checks, oldest first, and the reason.

        The reason is a sentence without its full stop.

        Raises
        ------
        DataError
            The counter was not read at a check, or runs backwards.
        """
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
        steps = [CheckStep(h, check.value, check.u) for h, check in zip(hours, history, strict=True)]
        interval, why = self.by.interval(steps, HOURS)
        a_day, since = self._a_day(history, hours)
        days = interval / a_day if a_day > 0.0 else self.longest_days
        why += f"; at {a_day:.3g} hours a day{since} that is {days:.0f} days"
        if days >= self.longest_days:
            return self.longest_days, f"{why}, and {self.longest_days:.0f} days is the longest"
        return days, why

    def _a_day(self, history: Sequence[Check], hours: Sequence[float]) -> tuple[float, str]:
        """Return the use per day since the last check a day or more ago, and since when."""
        for check, then in zip(history[-2::-1], hours[-2::-1], strict=True):
            days = (history[-1].at - check.at).total_seconds() / 86400.0
            if days >= 1.0:
                return (hours[-1] - then) / days, f" since {check.at:%Y-%m-%d}"
        return self.hours_a_day, " (assumed)"


Method = Staircase | DriftInterval | InUse


@dataclass(frozen=True)
class Due:
    """Date of the next check, and its reason.

    Attributes
    ----------
    date : datetime
        In the past if the check is overdue.
    because : str
        Reason as a sentence.
    """

    date: datetime
    because: str


def next_due(method: Method, history: Sequence[Check], now: datetime) -> Due:
    """Return the date of the next check.

    Parameters
    ----------
    history : sequence of Check
        Checks in any order. Without checks, the check is due now.

    Raises
    ------
    DataError
        `now` has no time zone, a check is after `now`, or the method raises it.

    Examples
    --------
    >>> from datetime import UTC
    >>> good = Check(datetime(2026, 1, 1, tzinfo=UTC), 0.05, 0.02)
    >>> due = next_due(Staircase(90, permitted=0.2), [good], datetime(2026, 2, 1, tzinfo=UTC))
    >>> print(f"{due.date:%Y-%m-%d}")
    2026-04-01
    """
    if now.tzinfo is None:
        raise DataError("is a date without a time zone.", do="Give it in UTC.", key="now")
    if not history:
        return Due(now, "It was never checked.")
    checks = in_order(history)
    last = checks[-1].at
    if last > now:
        raise DataError(
            f"has a check of {last:%Y-%m-%d %H:%M}, which is yet to come.",
            do="Set the clock of this machine, or of the one that measured.",
            key="at",
        )
    days, why = method.days(checks) if isinstance(method, InUse) else method.interval(days_of(checks), DAYS)
    date = last + timedelta(days=days)
    late = f"; overdue by {(now - date).days} days" if now - date >= timedelta(days=1) else ""
    return Due(date, f"{why[0].upper()}{why[1:]}{late}.")
