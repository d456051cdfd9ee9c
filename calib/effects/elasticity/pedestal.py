"""Pedestal: the support of the robot leans by its compliance times the overturning moment of the arm.

About x and about y, each with a compliance of its own: a table, a rail or a frame is seldom as stiff about one as
about the other. It leans about the origin of the base. In Nubiola's robots d_1 comes before the turns of the base,
which therefore turn about a point d_1 above it; the shift that this leaves out is added.
"""

from __future__ import annotations

from calib.arm.robot import Robot
from calib.effects.kind import OTHER_LOAD, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.gravity_regressors import Overturning
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "pedestal",
        words="leaning pedestal",
        check=(
            "Check the anchor bolts and the grout of the pedestal; put a dial gauge beside the foot and "
            "reach out the arm to each side."
        ),
        apart=(OTHER_LOAD,),
    ),
)


def pedestal(robot: Robot) -> Effect:
    """Compliance of the pedestal; parameters x and y, 1e-6 rad/(N.m), about those axes of the base."""
    about_x, about_y = Overturning(0), Overturning(1)
    height = robot.d[0] if robot.base == "thesis" else 0.0
    places_x = [("base.rx", about_x, 1.0), ("base.y", about_x, -height)]
    places_y = [("base.ry", about_y, 1.0), ("base.x", about_y, height)]
    return effect(
        "pedestal",
        "structure",
        "mounting",
        "The pedestal leans to where the arm reaches out.",
        {
            "x": ("1e-6 rad/(N.m)", 5.0, [place for place in places_x if place[2] != 0.0], (0.0, None)),
            "y": ("1e-6 rad/(N.m)", 5.0, [place for place in places_y if place[2] != 0.0], (0.0, None)),
        },
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidate, where the arm reaches out in different directions; else none."""
    overturning = survey.conditions.overturning
    if not (survey.strains(overturning[:, 0]) and survey.strains(overturning[:, 1])):
        return []
    return [Candidate(pedestal(survey.robot))]
