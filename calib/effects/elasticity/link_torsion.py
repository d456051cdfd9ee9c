"""Link torsion: a link twists under gravity, alpha_K grows by c M_x, M_x the moment at joint K about alpha's axis x.

The axis x is that of frame K-1 in modified DH, before joint K turns, and of frame K in standard DH, behind it. Links
are built for what they carry: the usual size is an angle under the largest moment.
"""

from __future__ import annotations

import numpy as np

from calib.arm.robot import Robot
from calib.effects.kind import OTHER_LOAD, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.gravity_regressors import Moment, MomentBehind
from calib.model.regressors import Regressor
from calib.scan.fixed import Candidate
from calib.units import to_display

_USUAL = 1e-3  # rad, under the largest moment
_UNIT = "1e-6 rad/(N.m)"


KINDS = (
    Kind(
        "link_torsion",
        words="twisting of link {joint}",
        check="Check the bolts at both ends of link {joint}, and the link for a crack if the value has grown.",
        apart=(OTHER_LOAD,),
    ),
)


def about_alpha(robot: Robot, link: int) -> Regressor:
    """Gravity moment about the axis of alpha of `link`."""
    return Moment(link, 0) if robot.convention == "mdh" else MomentBehind(link, robot.theta[link - 1])


def link_torsion(robot: Robot, link: int, largest: float) -> Effect:
    """Torsional compliance of `link`, whose moments reach `largest` N.mm; parameter c, 1e-6 rad/(N.m)."""
    size = to_display(_USUAL / largest, _UNIT)
    return effect(
        f"link_torsion:j{link}",
        "structure",
        "robot",
        f"Link {link} twists about its length under the weight it carries.",
        {"c": (_UNIT, size, [(f"alpha{link}", about_alpha(robot, link))], (0.0, None))},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, one for each link whose joint moved and that gravity twists, in varying strength."""
    candidates = []
    for link in survey.moving:
        moment = np.asarray(about_alpha(survey.robot, link).evaluate(survey.conditions))
        if survey.strains(moment):
            candidates.append(Candidate(link_torsion(survey.robot, link, survey.largest(moment))))
    return candidates
