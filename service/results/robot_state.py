"""The state of a robot by its history: its calibration, what the last watch says, and that a change is due now."""

from __future__ import annotations

from collections.abc import Sequence

from calib.upkeep import Due
from fleet.store import Entry, RobotKey, Said, Store

CHANGED = ("changed", "ambiguous", "unexplained")
"""Verdicts after which somebody has to act, whatever the dates of checks say."""
_MODELS = 50  # among which the newest calibration is looked for


def baseline_of(store: Store, robot: RobotKey, said: Sequence[Said]) -> Entry | None:
    """The newest calibration; the newest model where there is no calibration. said: all verdicts on the robot.

    What a watch has updated, and so is as old as its readings, is none: by it, what has changed would look unchanged
    before anybody mended it.
    """
    models = store.documents(robot, kind="model", limit=_MODELS)
    watched = {each.measured_at for each in said if each.kind in ("watch", "thermal")}
    return next((each for each in models if each.measured_at not in watched), models[0] if models else None)


def state_of(watched: Said | None, model: Entry | None) -> str:
    """The state of a robot by now: that of the last watch, unless a model is newer than it."""
    if watched is None:
        return "not_watched"
    if model is not None and model.measured_at > watched.measured_at:
        return "recalibrated"
    return watched.verdict if watched.verdict in ("unchanged", *CHANGED) else "not_watched"


def due_now(watched: Said | None, state: str) -> Due | None:
    """A robot that has changed is due since the watch that says so; None for any other state."""
    if watched is None or state not in CHANGED:
        return None
    return Due(
        watched.measured_at, f"Now: the last watch found it {watched.verdict}. {watched.advice}".strip()
    )
