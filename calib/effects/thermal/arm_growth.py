"""Arm growth: every length of the arm has grown by the same ratio since the calibration, because it is warmer.

It sets in between two campaigns; within one, growth follows the clock (`warm_up`) or the air (`thermal_growth`).
Source: aluminium grows by 23e-6 a kelvin, steel by 11.5e-6; an arm in production runs 5 to 20 K above the air.
"""

from __future__ import annotations

from calib.arm.robot import Robot
from calib.effects.kind import OTHER_WARMTH, Kind
from calib.effects.survey import Survey
from calib.effects.thermal.thermal_growth import lengths_with
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant

KINDS = (
    Kind(
        "arm_growth",
        words="arm warmer or colder than at its calibration",
        check="Ask how long the robot had run before it was measured, then and now, and what warms or cools it.",
        apart=(OTHER_WARMTH,),
        changed="The arm has grown by {size} since the calibration: it is warmer, or colder where it shrank.",
        remedy="Let the robot warm up as it had for the calibration, and measure again.",
    ),
)

_USUAL_PPM = 100.0  # aluminium by 4 K


def arm_growth(robot: Robot) -> Effect:
    """All lengths of the arm since its calibration; parameter expansion, ppm."""
    places = lengths_with(robot, Constant())
    return effect(
        "arm_growth",
        "thermal",
        "robot",
        "The arm is warmer or colder than at its calibration.",
        {"expansion": ("ppm", _USUAL_PPM, places, (-1500.0, 1500.0))},
    )


def changes(survey: Survey) -> list[Effect]:
    """The effect of an arm that has grown since a calibration."""
    return [arm_growth(survey.robot)]
