"""Drift of the instrument: its frame shifts, or turns about the station, in proportion to time.

Source: trackers warm up and tripods creep; AT960 drifts by tenths of a millimetre in two hours.
"""

from __future__ import annotations

import numpy as np

from calib.effects.kind import OTHER_STATION, OTHER_WARMTH, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Time
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "drift_translation",
        words="instrument shifting with time",
        check=(
            "Check the stand of the instrument: feet, clamp, floor; let it warm up for two hours and "
            "measure the nests between the poses."
        ),
        apart=(OTHER_WARMTH, OTHER_STATION),
        by_clock=True,
        changed="The instrument slid while it measured, by {size}.",
        remedy="Let the instrument warm up on a firm stand, and measure again.",
    ),
    Kind(
        "drift_rotation",
        words="instrument turning with time",
        check=(
            "Check that the instrument's stand does not creep or turn, keep the sun off it, and measure the "
            "nests between the poses."
        ),
        apart=(OTHER_WARMTH, OTHER_STATION),
        by_clock=True,
        changed="The instrument turned while it measured, by {size}.",
        remedy="Let the instrument warm up on a firm stand, and measure again.",
    ),
)


def drift_translation(start_s: float = 0.0) -> Effect:
    """The instrument's frame shifts from a time on; parameters x, y, z, mm/h."""
    acts = {axis: ("mm/h", 0.5, [(f"frame.{axis}", Time(start_s))], (-20.0, 20.0)) for axis in "xyz"}
    return effect(
        "drift_translation", "instrument", "instrument", "The instrument slides away with time.", acts
    )


def drift_rotation(start_s: float = 0.0) -> Effect:
    """The instrument's frame turns about the station from a time on; parameters rx, ry, rz, deg/h."""
    acts = {
        axis: ("deg/h", 0.02, [(f"frame.{axis}", Time(start_s))], (-2.0, 2.0)) for axis in ("rx", "ry", "rz")
    }
    return effect(
        "drift_rotation",
        "instrument",
        "instrument",
        "The instrument turns about its station with time.",
        acts,
    )


def changes(survey: Survey) -> list[Effect]:
    """Both drifts, from the first check pose on, where the frame was set up; none where times are not recorded."""
    start_s = float(np.min(survey.conditions.time))
    return [drift_translation(start_s), drift_rotation(start_s)] if offer(survey) else []


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, both drifts, where the times of the readings are recorded; else none."""
    if not (survey.recorded("time") and survey.varies(survey.conditions.time)):
        return []
    return [Candidate(drift_translation()), Candidate(drift_rotation())]
