"""Dead zone: the load rests on one flank of the teeth or the other, gap/2 x sign(tau), wherever the joint came from.

A gap is never negative. The sign is smoothed, tanh(tau / width), with a width of 5 % of the largest torque:
gears have some drag. The width is a constant of the effect, so that it predicts the same at other torques.
"""

from __future__ import annotations

import numpy as np

from calib.effects.kind import OTHER_SIDE, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.gravity_regressors import TorqueSign
from calib.scan.fixed import Candidate

SMOOTHED = 0.05  # share of the largest torque
_LEAST_CHANGE = 0.2  # of the 2 that a full change of side makes


KINDS = (
    Kind(
        "dead_zone",
        words="play of joint {joint} that gravity closes",
        check=(
            "Check gear and brake of joint {joint} for play with the load first on one side of the joint, "
            "then on the other; look at the counterbalance if it has one."
        ),
        apart=(OTHER_SIDE,),
    ),
)


def dead_zone(joint: int, width: float) -> Effect:
    """Dead zone of `joint`, smoothed over a torque of `width` N.mm; parameter gap, deg."""
    return effect(
        f"dead_zone:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} has play that gravity closes to the side to which it pulls.",
        {"gap": ("deg", 0.1, [(f"theta{joint}", TorqueSign(joint, width), 0.5)], (0.0, 1.0))},
        {"width_nmm": width},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint whose load comes near zero or changes its side: far from it the gap is an
    offset."""
    candidates = []
    for joint in survey.moving:
        torque = survey.conditions.torque[:, joint - 1]
        width = SMOOTHED * survey.largest(torque)
        if survey.loaded(joint) and np.ptp(np.tanh(torque / width)) > _LEAST_CHANGE:
            candidates.append(Candidate(dead_zone(joint, width)))
    return candidates
