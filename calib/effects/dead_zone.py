"""Dead zone: the load rests on one flank of the teeth or the other, gap/2 x sign(tau), wherever the joint came from.

The sign is smoothed, tanh(tau / width), with a width of 5 % of the largest torque: gears have some drag. The width
is a constant of the effect, so that it predicts the same at other torques. Source: contracts, table of labels.
"""

from __future__ import annotations

import numpy as np

from calib.effects.effect import Candidate, Effect, effect
from calib.effects.survey import Survey
from calib.regressors import TorqueSign

SMOOTHED = 0.05  # share of the largest torque


def dead_zone(joint: int, width: float) -> Effect:
    """Dead zone of `joint`, smoothed over a torque of `width` N.mm; parameter gap, deg."""
    return effect(
        f"dead_zone:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} has play that gravity closes to the side to which it pulls.",
        {"gap": ("deg", 0.1, [(f"theta{joint}", TorqueSign(joint, width), 0.5)])},
        {"width_nmm": width},
    )


def offer(survey: Survey) -> list[Candidate]:
    """One a joint on which gravity pulls both ways: from one side alone the gap is an offset."""
    candidates = []
    for joint in survey.joint_numbers:
        torque = survey.conditions.torque[:, joint - 1]
        if survey.loaded(joint) and np.min(torque) < 0.0 < np.max(torque):
            candidates.append(Candidate(dead_zone(joint, SMOOTHED * survey.largest(torque))))
    return candidates
