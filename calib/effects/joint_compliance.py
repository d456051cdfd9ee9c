"""Joint compliance: the gear of a joint yields to gravity, never against it, c tau. Source: Nubiola, Annex I (level
3)."""

from __future__ import annotations

from calib.effects.effect import Candidate, Effect, effect
from calib.effects.survey import Survey
from calib.regressors import Torque


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
    """One a joint that gravity loads, but for those whose compliance the base model finds."""
    return [Candidate(joint_compliance(k)) for k in survey.moving if survey.loaded(k)]
