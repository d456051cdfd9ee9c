"""Settling: the reading was taken before the joint had arrived, -k (theta - previous theta).

Where every last move is of one length its column is that of `lost_motion`, and that of backlash with the sign turned.
The usual size is what four time constants leave, exp(-4). Source: contracts, table of labels; the thesis waits 4 s
before every reading (2.2).
"""

from __future__ import annotations

from calib.effects.effect import Candidate, Effect, effect
from calib.effects.survey import Survey
from calib.regressors import LastMove


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
    """One a joint whose last moves differ."""
    moved = survey.conditions.joints - survey.conditions.previous
    return [Candidate(settling(k)) for k in survey.moving if survey.varies(moved[:, k - 1])]
