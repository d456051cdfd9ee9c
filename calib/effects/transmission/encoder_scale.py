"""Encoder scale: the joint turns by (1 + k) times the counted angle, k theta. Source: level-1 models, Nubiola ch. 1.

Gear ratios are whole numbers and encoders have whole counts: what is left is a belt's pitch, per mille at most.
"""

from __future__ import annotations

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import JointAngle
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "encoder_scale",
        words="gear ratio of joint {joint}",
        check=(
            "Compare the gear ratio of joint {joint} in the controller with the one on its type plate, and "
            "look for a belt of the wrong pitch."
        ),
        apart=(),
    ),
)


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
    """The candidates, one for each joint that moved, unless a curve over its angle has the scale already."""
    return [Candidate(encoder_scale(k)) for k in survey.moving if k not in survey.curves]
