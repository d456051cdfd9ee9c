"""Joint offset: the zero of a joint is off by a constant angle; the group `geometry` contains it as theta_K.

The zero of joint 1 is the turn of the base about z, which every model frees.
"""

from __future__ import annotations

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "joint_offset",
        words="zero of joint {joint}",
        check=(
            "Bring joint {joint} to its calibration mark and read the counter; master the axis anew if it "
            "is off."
        ),
        apart=(),
    ),
)


def joint_offset(joint: int) -> Effect:
    """Offset of the zero of `joint`; parameter offset, deg."""
    return effect(
        f"joint_offset:j{joint}",
        "transmission",
        "robot",
        f"The zero of joint {joint} is off.",
        {"offset": ("deg", 0.3, [(f"theta{joint}", Constant())])},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that moved, from 2 on, except those whose zero the base model identifies."""
    return [Candidate(joint_offset(k)) for k in survey.moving if k > 1]
