"""Lost motion: the joint stops short of its target from either side, -width/2 x side of approach.

The motor's side counts, friction winds up the drive, and what is left of the path to the gap's other flank is never
made: the opposite of `backlash`, by whose law the joint comes to rest on the far side of its gap. Where every last move
is of one length its column is that of `settling`. Source: ISO 230-2 (reversal value).
"""

from __future__ import annotations

from calib.effects.kind import OTHER_SIDE, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Side
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "lost_motion",
        words="lost motion of joint {joint}",
        check=(
            "Check the drive of joint {joint} for friction and for play between motor and gear (belt, "
            "coupling, key): move it to and fro by a tenth of a degree and watch when a dial gauge follows."
        ),
        apart=(OTHER_SIDE,),
    ),
)


def lost_motion(joint: int) -> Effect:
    """Lost motion of `joint`; parameter width, deg, never negative."""
    return effect(
        f"lost_motion:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} stops short of where it is sent, from either side.",
        {"width": ("deg", 0.1, [(f"theta{joint}", Side(joint), -0.5)], (0.0, 1.0))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that was approached from both sides."""
    side = survey.conditions.side
    return [Candidate(lost_motion(k)) for k in survey.moving if survey.varies(side[:, k - 1])]
