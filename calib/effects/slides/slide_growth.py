"""Thermal growth of a slide: rack, screw or scale lengthens with the air, k q (T - T-). Steel: 11 to 12e-6/K."""

from __future__ import annotations

from calib.effects.kind import OTHER_WARMTH, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.slide_regressors import WarmTravel
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "slide_growth",
        words="growth of axis {joint} with the air temperature",
        check="Look what warms rack or screw of axis {joint} (sun, drive, hall), and measure at a steady temperature.",
        apart=(OTHER_WARMTH,),
    ),
)


def slide_growth(joint: int, reference_c: float) -> Effect:
    """Growth of the travel of `joint` with the air temperature above `reference_c`; parameter k, 1e-6/K."""
    return effect(
        f"slide_growth:j{joint}",
        "thermal",
        "robot",
        f"The travel of joint {joint} grows with the air temperature.",
        {"k": ("1e-6/K", 12.0, [(f"d{joint}", WarmTravel(joint, reference_c))], (-50.0, 100.0))},
        {"reference_c": reference_c},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that slid, where the temperature was recorded and varied."""
    air_c = survey.air_c
    return [] if air_c is None else [Candidate(slide_growth(k, air_c)) for k in survey.sliding]
