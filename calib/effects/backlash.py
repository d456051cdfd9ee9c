"""Backlash: the joint stops half a gap short on the side from which it came, gap/2 x side of approach.

A gap is never less than nothing. Invisible, not absent, when every reading was approached from one side.
Source: Nubiola 2.4.1 and 2.5.
"""

from __future__ import annotations

from calib.effects.effect import Candidate, Effect, effect
from calib.effects.survey import Survey
from calib.regressors import Side


def backlash(joint: int) -> Effect:
    """Backlash of `joint`; parameter gap, deg."""
    return effect(
        f"backlash:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} has play: it stops short on the side from which it arrives.",
        {"gap": ("deg", 0.1, [(f"theta{joint}", Side(joint), 0.5)], (0.0, 1.0))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """One a joint that was approached from both sides."""
    side = survey.conditions.side
    return [Candidate(backlash(k)) for k in survey.moving if survey.varies(side[:, k - 1])]
