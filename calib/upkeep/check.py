"""A check: a value found on a day, its uncertainty, and the robot's hours of use by then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import datetime
from typing import NamedTuple

import numpy as np

from calib.errors import DataError


@dataclass(frozen=True)
class Check:
    """A value with its expanded uncertainty U (k = 2), any unit, from readings of its own.

    at: date and time with its zone; used_h: hours of use that the robot's counter showed, None where nobody read it.

    Raises DataError for a date without a zone, a value or U that is no number, and a negative U.
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
class Step:
    """A check on an axis on which intervals are counted: days since the first check, or hours of use."""

    x: float
    value: float
    u: float


class Unit(NamedTuple):
    """The unit in which intervals are counted, in the singular and the plural."""

    one: str
    many: str

    def of(self, interval: float) -> str:
        """An interval in words."""
        return f"{interval:.0f} {self.many}"


DAYS = Unit("day", "days")
HOURS = Unit("hour of use", "hours of use")


def in_order(history: Sequence[Check]) -> list[Check]:
    """The checks, oldest first."""
    return sorted(history, key=lambda check: check.at)


def days_of(history: Sequence[Check]) -> list[Step]:
    """Checks, oldest first, by days since the first."""
    first = history[0].at
    return [Step((c.at - first).total_seconds() / 86400.0, c.value, c.u) for c in history]
