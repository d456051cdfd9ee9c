"""The date of the next check, and why."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime, timedelta

from calib.errors import DataError
from calib.upkeep.check import DAYS, Check, days_of, in_order
from calib.upkeep.drift import Drift
from calib.upkeep.in_use import InUse
from calib.upkeep.staircase import Staircase

Method = Staircase | Drift | InUse


@dataclass(frozen=True)
class Due:
    """The date of the next check, in the past where it is overdue; because: a sentence."""

    date: datetime
    because: str


def next_due(method: Method, history: Sequence[Check], now: datetime) -> Due:
    """The date to check next. history: in any order; one that is empty makes the check due now.

    Raises DataError for `now` without a zone, a check after `now`, and as the method does.

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
