"""Joint compliance: the gear of a joint deflects with the gravity torque, c tau, with c >= 0. Source: Nubiola, Annex
I (level 3)."""

from __future__ import annotations

from calib.effects.kind import OTHER_LOAD, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.gravity_regressors import Torque
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "joint_compliance",
        words="gear of joint {joint} yielding to gravity",
        check=(
            "Check the payload that the controller was told and, on joint {joint}, the bolts of gear and "
            "motor; hang a known mass on the flange and watch a dial gauge."
        ),
        apart=(OTHER_LOAD,),
    ),
)


def joint_compliance(joint: int) -> Effect:
    """Compliance of the gear of `joint`; parameter c, 1e-6 rad/(N.mm)."""
    return effect(
        f"joint_compliance:j{joint}",
        "transmission",
        "robot",
        f"The gear of joint {joint} yields to gravity.",
        {"c": ("1e-6 rad/(N.mm)", 1.0, [(f"theta{joint}", Torque(joint))], (0.0, None))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that gravity loads, except those whose compliance the base model
    identifies."""
    return [Candidate(joint_compliance(k)) for k in survey.moving if survey.loaded(k)]
