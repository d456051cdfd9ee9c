"""Ladder at the head of a report: errors from the robot as found to the robot verified."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from calib.fit import ErrorStatistics
from calib.units import percent
from service import wording

NOMINAL = "Nominal robot as found, placed by its base"
BASE = "Identified base model"
EFFECTS = "With the effects found"
CARRIED = "With carried terms"
VERIFIED = "Verified on the robot"
HELD_OUT = "held-out readings"
DRIVEN = "new poses, driven corrected"


@dataclass(frozen=True)
class LadderStep:
    """One model of the ladder.

    It has the readings that judged it, its errors, and the difference of its RMS from the rung above.
    """

    name: str
    judged: str
    errors: ErrorStatistics
    step: str  # empty on the first rung


def ladder_of(
    held_out: Mapping[str, ErrorStatistics | None], verified: ErrorStatistics | None = None
) -> list[LadderStep]:
    """Return the rungs from top to bottom.

    `held_out` maps a model to its errors on the held-out readings, or None. `verified` are the errors of targets
    that the robot was driven to with the correction.
    """
    judged = [(name, HELD_OUT, errors) for name, errors in held_out.items() if errors is not None]
    if verified is not None:
        judged.append((VERIFIED, DRIVEN, verified))
    above = [None, *(errors for _, _, errors in judged)]
    return [
        LadderStep(name, where, errors, _step(before, errors))
        for before, (name, where, errors) in zip(above, judged, strict=False)
    ]


def _step(before: ErrorStatistics | None, after: ErrorStatistics) -> str:
    """Return the change of the RMS in mm and in percent, e.g. "−0.653 mm (−98 %)"."""
    if before is None:
        return ""
    change = after.rms - before.rms
    if wording.millimetres(abs(change)) == wording.millimetres(0.0):
        return "none"
    sign = "−" if change < 0.0 else "+"
    share = f" ({sign}{percent(abs(change) / before.rms)})" if before.rms > 0.0 else ""
    return f"{sign}{wording.millimetres(abs(change))} mm{share}"
