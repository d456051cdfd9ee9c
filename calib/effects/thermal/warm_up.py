"""Warm-up: the arm's own heat makes every length grow towards a limit, a and d times 1 + alpha (1 - exp(-t/T_c)).

The time constant T_c is scanned and refined. Nubiola warms up for 1 h (thesis 2.2).
"""

from __future__ import annotations

from functools import partial

import numpy as np

from calib.arm.robot import Robot
from calib.effects.kind import OTHER_WARMTH, Kind
from calib.effects.survey import Survey
from calib.effects.thermal.thermal_growth import lengths_with
from calib.model.effect import Effect, effect
from calib.model.regressors import WarmUp
from calib.scan.shapes import Shapes

TIME_CONSTANT = "time_constant_s"
SHORTEST, LONGEST = 300.0, 18000.0  # s
_PLACES = 15
_MOST = 1500.0  # ppm: aluminium by 60 K; negative where an arm cools down


KINDS = (
    Kind(
        "warm_up",
        words="arm warming up",
        check="Let the robot run its warm-up cycle for an hour before it is measured or works.",
        apart=(OTHER_WARMTH,),
    ),
)


def warm_up(robot: Robot, time_constant_s: float) -> Effect:
    """The arm warms up with a time constant in s; parameter expansion, ppm, what it has grown by in the end."""
    places = lengths_with(robot, WarmUp(time_constant_s))
    return effect(
        "warm_up",
        "thermal",
        "robot",
        "The arm grows while it warms up from a cold start.",
        {"expansion": ("ppm", 300.0, places, (-_MOST, _MOST))},
        {TIME_CONSTANT: time_constant_s},
    )


def offer(survey: Survey) -> list[Shapes]:
    """The candidate, a scan up to a time constant as long as the session: a slower warm-up is a straight line in
    time."""
    time = survey.conditions.time
    if not (survey.recorded("time") and survey.varies(time)):
        return []
    longest = min(LONGEST, float(np.ptp(time)))
    if longest <= SHORTEST:
        return []
    values = np.geomspace(SHORTEST, longest, _PLACES)
    return [Shapes("warm_up", TIME_CONSTANT, values, partial(warm_up, survey.robot), (SHORTEST, LONGEST))]
