"""Compliance of a slide: the carriage deflects along its axis under the weight that it carries, c F.

If the axis keeps its direction, the force is constant and part of the zero: then nothing is offered.
"""

from __future__ import annotations

from calib.effects.kind import OTHER_LOAD, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.gravity_regressors import Torque
from calib.scan.fixed import Candidate

_LEAST_FORCE = 1.0  # N

KINDS = (
    Kind(
        "slide_compliance",
        words="yielding drive of slide {joint}",
        check="Check belt tension, or nut and bearings of the screw, of axis {joint} under its load.",
        apart=(OTHER_LOAD,),
    ),
)


def slide_compliance(joint: int) -> Effect:
    """Compliance along the axis of `joint`; parameter c, um/N."""
    return effect(
        f"slide_compliance:j{joint}",
        "structure",
        "robot",
        f"The drive of joint {joint} yields to the weight along its axis.",
        {"c": ("um/N", 0.1, [(f"d{joint}", Torque(joint))], (0.0, None))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each joint that slid and along which gravity pulls, in varying strength."""
    force = survey.conditions.torque
    return [
        Candidate(slide_compliance(k))
        for k in survey.sliding
        if survey.varies(force[:, k - 1]) and survey.largest(force[:, k - 1]) > _LEAST_FORCE
    ]
