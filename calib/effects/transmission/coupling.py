"""Coupling: joint B turns by k theta_A, because B's drive or its cables run through joint A.

A is always nearer to the base than B: a drive passes the joints that carry it, so their turning winds it up;
the joints beyond it do not affect it. Offered are neighbours, where a cable or a belt crosses from one link to the
next, and 4 with 6, since hollow wrists drive joint 6 by a shaft through joints 4 and 5. Controllers compensate
the ratio of a hollow wrist; the effect is its remaining error.
"""

from __future__ import annotations

from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import JointAngle
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "coupling",
        words="coupling of joints {joint}",
        check=(
            "Compare the coupling ratio of joints {joint} in the controller with the robot's data sheet, "
            "and look for a cable or hose that drags from one joint to the other."
        ),
        apart=(),
    ),
)


def coupling(first: int, second: int) -> Effect:
    """Joint `second` turns with joint `first`; parameter k, ppm."""
    return effect(
        f"coupling:j{first}-j{second}",
        "transmission",
        "robot",
        f"Joint {second} turns a little when joint {first} does: its drive runs through it.",
        {"k": ("ppm", 1000.0, [(f"theta{second}", JointAngle(first))], (-2e4, 2e4))},
    )


def pairs(joints: int) -> list[tuple[int, int]]:
    """The couplings that a robot of so many joints may have."""
    neighbours = [(k, k + 1) for k in range(1, joints)]
    return [*neighbours, (4, 6)] if joints == 6 else neighbours


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each pair that turns and of which the first joint moved."""
    slides = survey.robot.slides
    return [
        Candidate(coupling(a, b))
        for a, b in pairs(survey.robot.joints)
        if a in survey.moving and b not in slides
    ]
