"""Thermal growth: every length of the arm grows by the same ratio per kelvin, a and d times 1 + alpha (T - T-).

Source: steel 11.5, aluminium 23 (1e-6/K).
"""

from __future__ import annotations

from calib.arm.robot import Robot
from calib.effects.kind import OTHER_WARMTH, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Regressor, Temperature
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "thermal_growth",
        words="arm growing with the air temperature",
        check=(
            "Steady the air of the cell, or record its temperature and correct for it; keep sun and hot "
            "parts away from the arm."
        ),
        apart=(OTHER_WARMTH,),
    ),
)


def lengths_with(robot: Robot, warmth: Regressor) -> list[tuple[str, Regressor, float]]:
    """The slots of all link lengths, which grow by their nominal lengths, mm, times `warmth`."""
    lengths = [(f"a{k + 1}", a) for k, a in enumerate(robot.a)] + [
        (f"d{k + 1}", d) for k, d in enumerate(robot.d)
    ]
    return [(slot, warmth, length) for slot, length in lengths if length != 0.0]


def thermal_growth(robot: Robot, reference_c: float) -> Effect:
    """The arm grows with the air temperature; parameter expansion, 1e-6/K."""
    places = lengths_with(robot, Temperature(reference_c))
    return effect(
        "thermal_growth",
        "thermal",
        "robot",
        "The arm grows and shrinks with the air temperature.",
        {"expansion": ("1e-6/K", 50.0, places, (0.0, 500.0))},
        {"reference_c": reference_c},
    )


def offer(survey: Survey) -> list[Candidate]:
    """The candidate, where the temperature was recorded and varied; else none."""
    air_c = survey.air_c
    return [] if air_c is None else [Candidate(thermal_growth(survey.robot, air_c))]
