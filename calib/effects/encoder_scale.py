"""Encoder scale: the joint turns by (1 + k) times what it counts, k theta. Source: level-1 models, Nubiola ch. 1.

Gear ratios are whole numbers and encoders have whole counts: what is left is a belt's pitch, per mille at most.
"""

from __future__ import annotations

from calib.effects.effect import Candidate, Effect, effect
from calib.effects.survey import Survey
from calib.regressors import JointAngle


def encoder_scale(joint: int) -> Effect:
    """Scale error of the encoder of `joint`; parameter scale, ppm."""
    return effect(
        f"encoder_scale:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} turns by more or less than it counts, in proportion to its angle.",
        {"scale": ("ppm", 1000.0, [(f"theta{joint}", JointAngle(joint))], (-1500.0, 1500.0))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """One a joint that moved."""
    joints = survey.conditions.joints
    return [Candidate(encoder_scale(k)) for k in survey.joint_numbers if survey.varies(joints[:, k - 1])]
