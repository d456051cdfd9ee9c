"""Cubic stiffness: a gear is softer or stiffer under large loads, c tau^3 beside its compliance c tau.

Source: contracts, table of labels; strain-wave gears are soft at small torques (wind-up curves of their makers).
"""

from __future__ import annotations

from calib.effects.effect import Candidate, Effect, effect
from calib.effects.survey import Survey
from calib.regressors import TorqueCubed
from calib.units import to_display

_USUAL = 1e-3  # rad, at the largest torque
_UNIT = "1e-15 rad/(N.mm)^3"


def cubic_stiffness(joint: int, largest: float) -> Effect:
    """Cubic compliance of `joint`, whose torques reach `largest` N.mm; parameter c, 1e-15 rad/(N.mm)^3."""
    size = to_display(_USUAL / largest**3, _UNIT)
    return effect(
        f"cubic_stiffness:j{joint}",
        "transmission",
        "robot",
        f"The gear of joint {joint} yields out of proportion to a large load.",
        {"c": (_UNIT, size, [(f"theta{joint}", TorqueCubed(joint))])},
    )


def offer(survey: Survey) -> list[Candidate]:
    """One a joint that gravity loads."""
    torque = survey.conditions.torque
    return [
        Candidate(cubic_stiffness(k, survey.largest(torque[:, k - 1])))
        for k in survey.moving
        if survey.loaded(k)
    ]
