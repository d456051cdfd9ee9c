"""Cubic stiffness: a gear is softer or stiffer under large loads, c tau^3 beside its compliance c tau.

Strain-wave gears are soft at small torques (wind-up curves of their makers).
"""

from __future__ import annotations

from calib.effects.kind import OTHER_LOAD, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.gravity_regressors import TorqueCubed
from calib.scan.fixed import Candidate
from calib.units import to_display

_USUAL = 1e-3  # rad, at the largest torque
_UNIT = "1e-15 rad/(N.mm)^3"


KINDS = (
    Kind(
        "cubic_stiffness",
        words="gear of joint {joint} yielding to large loads",
        check=(
            "Check the gear of joint {joint} for worn teeth, and that the load is within what it is rated "
            "for."
        ),
        apart=(OTHER_LOAD,),
    ),
)


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
    """The candidates, one for each joint that gravity loads."""
    torque = survey.conditions.torque
    return [
        Candidate(cubic_stiffness(k, survey.largest(torque[:, k - 1])))
        for k in survey.moving
        if survey.loaded(k)
    ]
