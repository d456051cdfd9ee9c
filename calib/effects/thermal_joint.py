"""Thermal joint: a joint turns with the air temperature, k (T - T-), as encoder, brake and gear housing warm up."""

from __future__ import annotations

import numpy as np

from calib.effects.effect import Candidate, Effect, effect
from calib.effects.survey import Survey
from calib.regressors import Temperature


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
    """One a joint, where the temperature was recorded and moved."""
    temperature = survey.conditions.temperature
    if not (survey.recorded("temperature") and survey.varies(temperature)):
        return []
    return [Candidate(thermal_joint(k, float(np.mean(temperature)))) for k in survey.moving]
