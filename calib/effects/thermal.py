"""Effects of temperature: of the air, and of the heat that the arm generates.

Steel grows by 11.5e-6 per kelvin, aluminium by 23e-6. An arm in production runs 5 to 20 K above the air.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from calib.arm.robot import Robot
from calib.effects.kind import OTHER_WARMTH, EffectKind, EffectModule, Row
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant, Regressor, Temperature, WarmUpRegressor
from calib.scan.families import Candidate, Shapes

TIME_CONSTANT = "time_constant_s"
_SHORTEST, _LONGEST = 300.0, 18000.0  # s
_PLACES = 15
_MOST = 1500.0  # ppm: aluminium by 60 K; negative where an arm cools down
_USUAL_PPM = 100.0  # aluminium by 4 K


def _lengths_with(robot: Robot, warmth: Regressor) -> list[tuple[str, Regressor, float]]:
    """List the slots of all link lengths.

    They grow by their nominal lengths, mm, times `warmth`.
    """
    lengths = [(f"a{k + 1}", a) for k, a in enumerate(robot.a)] + [
        (f"d{k + 1}", d) for k, d in enumerate(robot.d)
    ]
    return [(slot, warmth, length) for slot, length in lengths if length != 0.0]


def thermal_growth(robot: Robot, reference_c: float) -> Effect:
    """Build the growth of the arm with the air temperature; parameter expansion, 1e-6/K."""
    places = _lengths_with(robot, Temperature(reference_c))
    return effect(
        "thermal_growth",
        "thermal",
        "robot",
        "The arm grows and shrinks with the air temperature.",
        {"expansion": ("1e-6/K", 50.0, places, (0.0, 500.0))},
        {"reference_c": reference_c},
    )


def _offer_thermal_growth(survey: Survey) -> list[Candidate]:
    air_c = survey.air_c
    return [] if air_c is None else [Candidate(thermal_growth(survey.robot, air_c))]


thermal_joint = Row(
    EffectKind(
        "thermal_joint",
        words="zero of joint {joint} moving with the air temperature",
        check=(
            "Look for what warms the housing of joint {joint} (motor, brake, sun), and measure again at a "
            "steady temperature."
        ),
        apart=(OTHER_WARMTH,),
    ),
    law=(
        "Thermal joint: a joint turns with the air temperature, k (T - T-), as encoder, brake and gear housing "
        "warm up."
    ),
    means="The zero of joint {joint} moves with the air temperature.",
    parameter="k",
    unit="deg/K",
    size=0.05,
    slot="theta",
    regressor=lambda joint, reference_c: Temperature(reference_c),
    where=lambda survey: [] if survey.air_c is None else survey.moving,
    bounds=(-0.5, 0.5),
    group="thermal",
    measure=lambda survey, joint: survey.air_c or 0.0,
    shape="reference_c",
)


def warm_up(robot: Robot, time_constant_s: float) -> Effect:
    """Build the growth of the arm by its own heat; parameter expansion, ppm.

    The lengths are multiplied by 1 + expansion (1 - exp(-t/T_c)). The time constant T_c, s, is scanned and refined.
    Nubiola warms up for 1 h (thesis 2.2).
    """
    places = _lengths_with(robot, WarmUpRegressor(time_constant_s))
    return effect(
        "warm_up",
        "thermal",
        "robot",
        "The arm grows while it warms up from a cold start.",
        {"expansion": ("ppm", 300.0, places, (-_MOST, _MOST))},
        {TIME_CONSTANT: time_constant_s},
    )


def _offer_warm_up(survey: Survey) -> list[Shapes]:
    """Offer a scan up to a time constant as long as the session.

    A slower warm-up is a straight line in time.
    """
    time = survey.conditions.time
    if not (survey.recorded("time") and survey.varies(time)):
        return []
    longest = min(_LONGEST, float(np.ptp(time)))
    if longest <= _SHORTEST:
        return []
    values = np.geomspace(_SHORTEST, longest, _PLACES)
    return [Shapes("warm_up", TIME_CONSTANT, values, partial(warm_up, survey.robot), (_SHORTEST, _LONGEST))]


def arm_growth(robot: Robot) -> Effect:
    """Build the growth of all lengths since the calibration; parameter expansion, ppm."""
    places = _lengths_with(robot, Constant())
    return effect(
        "arm_growth",
        "thermal",
        "robot",
        "The arm is warmer or colder than at its calibration.",
        {"expansion": ("ppm", _USUAL_PPM, places, (-1500.0, 1500.0))},
    )


THERMAL_GROWTH = EffectModule(
    "Thermal growth: every length of the arm grows by the same ratio per kelvin, a and d times 1 + alpha (T - T-).",
    (
        EffectKind(
            "thermal_growth",
            words="arm growing with the air temperature",
            check=(
                "Steady the air of the cell, or record its temperature and correct for it; keep sun and hot "
                "parts away from the arm."
            ),
            apart=(OTHER_WARMTH,),
        ),
    ),
    _offer_thermal_growth,
)
WARM_UP = EffectModule(
    "Warm-up: the arm's own heat makes every length grow towards a limit, a and d times 1 + alpha (1 - exp(-t/T_c)).",
    (
        EffectKind(
            "warm_up",
            words="arm warming up",
            check="Let the robot run its warm-up cycle for an hour before it is measured or works.",
            apart=(OTHER_WARMTH,),
        ),
    ),
    _offer_warm_up,
)
ARM_GROWTH = EffectModule(
    "Arm growth: every length of the arm has grown by the same ratio since the calibration, because it is warmer.",
    (
        EffectKind(
            "arm_growth",
            words="arm warmer or colder than at its calibration",
            check="Ask how long the robot had run before it was measured, then and now, and what warms or cools it.",
            apart=(OTHER_WARMTH,),
            changed="The arm has grown by {size} since the calibration: it is warmer, or colder where it shrank.",
            remedy="Let the robot warm up as it had for the calibration, and measure again.",
        ),
    ),
    lambda survey: [],
    lambda survey: [arm_growth(survey.robot)],
)
