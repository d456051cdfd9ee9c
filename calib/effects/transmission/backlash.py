"""Backlash: the joint stops half a gap short on the side from which it came, gap/2 x side of approach.

A gap is never negative. If every reading was approached from one side, backlash cannot be seen.
Source: Nubiola 2.4.1 and 2.5.
"""

from __future__ import annotations

from calib.effects.kind import OTHER_SIDE, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Side
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "backlash",
        words="play of joint {joint}",
        check=(
            "Check the preload of the gear of joint {joint}: with the brakes on, push the arm by hand both "
            "ways and read a dial gauge; compare with the limit in the maker's manual."
        ),
        apart=(OTHER_SIDE,),
        changed="Joint {joint} has another play than at the calibration: {size}.",
        remedy="Have the gear of joint {joint} checked; until then correct targets with the updated model.",
    ),
)


def backlash(joint: int) -> Effect:
    """Backlash of `joint`; parameter gap, deg."""
    return effect(
        f"backlash:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} has play: it stops short on the side from which it arrives.",
        {"gap": ("deg", 0.1, [(f"theta{joint}", Side(joint), 0.5)], (0.0, 1.0))},
    )


def changes(survey: Survey) -> list[Effect]:
    """The effects of play that began since a calibration, for every joint that was approached from both sides."""
    return [candidate.effect for candidate in offer(survey)]


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that was approached from both sides."""
    side = survey.conditions.side
    return [Candidate(backlash(k)) for k in survey.moving if survey.varies(side[:, k - 1])]
