"""Scale of a slide: the carriage moves (1 + k) times the counted travel, k q, by the pitch of rack, screw or belt."""

from __future__ import annotations

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import JointAngle
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "slide_scale",
        words="scale of slide {joint}",
        check=(
            "Compare the pitch of rack, screw or belt of axis {joint} in the controller with its drawing, and drive "
            "the whole travel beside a laser or a tape."
        ),
        apart=(),
    ),
)


def slide_scale(joint: int) -> Effect:
    """Scale error of the joint that slides; parameter scale, ppm."""
    return effect(
        f"slide_scale:j{joint}",
        "transmission",
        "robot",
        f"Joint {joint} slides by more or less than it counts, in proportion to its travel.",
        {"scale": ("ppm", 200.0, [(f"d{joint}", JointAngle(joint))], (-20000.0, 20000.0))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that slid."""
    return [Candidate(slide_scale(k)) for k in survey.sliding]
