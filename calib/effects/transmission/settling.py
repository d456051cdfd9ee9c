"""Settling: the reading was taken before the joint had arrived, -k (theta - previous theta).

Where every last move is of one length its column is that of `lost_motion`, and that of backlash with the sign turned.
The usual size is what four time constants leave, exp(-4): Nubiola waits 4 s before every
reading (thesis 2.2).
"""

from __future__ import annotations

from calib.effects.kind import OTHER_SIDE, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import LastMove
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "settling",
        words="slow settling of joint {joint}",
        check=(
            "Let the arm stand longer before each reading and measure a few poses again; if that helps, "
            "look for friction and at the servo settings of joint {joint}."
        ),
        apart=(OTHER_SIDE,),
    ),
)


def settling(joint: int) -> Effect:
    """Share of its last move that `joint` still lacks, none or some; parameter k, ppm."""
    return effect(
        f"settling:j{joint}",
        "procedure",
        "robot",
        f"Joint {joint} still lags behind its last move when it is measured.",
        {"k": ("ppm", 2e4, [(f"theta{joint}", LastMove(joint), -1.0)], (0.0, 2e5))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint whose last moves differ."""
    moved = survey.conditions.joints - survey.conditions.previous
    return [Candidate(settling(k)) for k in survey.moving if survey.varies(moved[:, k - 1])]
