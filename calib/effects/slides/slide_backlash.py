"""Backlash of a slide: the carriage stops half a gap short on the side from which it came, gap/2 x side of approach."""

from __future__ import annotations

from calib.effects.kind import OTHER_SIDE, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Side
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "slide_backlash",
        words="play of slide {joint}",
        check=(
            "Check the play between pinion and rack, or the preload of nut or belt, of axis {joint}: push the carriage "
            "both ways with the brakes on and read a dial gauge."
        ),
        apart=(OTHER_SIDE,),
        changed="Axis {joint} has another play than at the calibration: {size}.",
        remedy="Have the drive of axis {joint} checked; until then correct targets with the updated model.",
    ),
)


def slide_backlash(joint: int) -> Effect:
    """Backlash of the joint that slides; parameter gap, mm."""
    return effect(
        f"slide_backlash:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} has play: it stops short on the side from which it arrives.",
        {"gap": ("mm", 0.2, [(f"d{joint}", Side(joint), 0.5)], (0.0, 5.0))},
    )


def changes(survey: Survey) -> list[Effect]:
    """The effects of play that began since a calibration, for every slide that was approached from both sides."""
    return [candidate.effect for candidate in offer(survey)]


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that slid and was approached from both sides."""
    side = survey.conditions.side
    return [Candidate(slide_backlash(k)) for k in survey.sliding if survey.varies(side[:, k - 1])]
