"""The state of a robot by its history: what the last watch says, that a change is due now, and dates nobody can
believe."""

from __future__ import annotations

from datetime import UTC, datetime, timedelta

from calib.upkeep import Due
from fleet.store import Known, Standing

CHANGED = ("changed", "ambiguous", "unexplained")
"""Verdicts after which somebody has to act, whatever the dates of checks say."""
_EARLIEST = datetime(2001, 1, 1, tzinfo=UTC)
"""Clocks whose battery is empty begin in 1970, 1980 or 2000."""
_AHEAD = timedelta(days=1)


def state_of(standing: Standing) -> str:
    """The state of a robot by now: that of the last watch, unless it is retired or a model is newer."""
    watched, model = standing.watched, standing.baseline
    if standing.known.retired:
        return "retired"
    if watched is None:
        return "not_watched"
    if model is not None and model.measured_at > watched.measured_at:
        return "recalibrated"
    return watched.verdict if watched.verdict in ("unchanged", *CHANGED) else "not_watched"


def due_now(standing: Standing) -> Due | None:
    """A robot that has changed is due since the watch that says so; None for any other state."""
    watched = standing.watched
    if watched is None or state_of(standing) not in CHANGED:
        return None
    return Due(
        watched.measured_at, f"Now: the last watch found it {watched.verdict}. {watched.advice}".strip()
    )


def doubtful_date(known: Known, now: datetime) -> datetime | None:
    """A date among the documents of a robot that only a wrong clock can have written; None where there is none."""
    if known.last > now + _AHEAD:
        return known.last
    return known.first if known.first < _EARLIEST else None
