"""Thermal joint: a joint turns with the air temperature, k (T - T-), as encoder, brake and gear housing warm up."""

from __future__ import annotations

from calib.effects.kind import OTHER_WARMTH, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Temperature
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "thermal_joint",
        words="zero of joint {joint} moving with the air temperature",
        check=(
            "Look for what warms the housing of joint {joint} (motor, brake, sun), and measure again at a "
            "steady temperature."
        ),
        apart=(OTHER_WARMTH,),
    ),
)


def thermal_joint(joint: int, reference_c: float) -> Effect:
    """Turn of `joint` with the air temperature above `reference_c`; parameter k, deg/K."""
    return effect(
        f"thermal_joint:j{joint}",
        "thermal",
        "robot",
        f"The zero of joint {joint} moves with the air temperature.",
        {"k": ("deg/K", 0.05, [(f"theta{joint}", Temperature(reference_c))], (-0.5, 0.5))},
        {"reference_c": reference_c},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint, where the temperature was recorded and varied."""
    air_c = survey.air_c
    return [] if air_c is None else [Candidate(thermal_joint(k, air_c)) for k in survey.moving]
