"""The model of a robot: effects on the slots of its kinematic chain, their regressors, and the predicted readings."""

from calib.model.axis import Axis, Drawn
from calib.model.check import check_effect
from calib.model.effect import Effect, effect
from calib.model.model import Design, RobotModel
from calib.model.regressors import (
    Regressor,
)
from calib.model.stated import FLANGE, StatedConditions, conditions_at, series_of

__all__ = [
    "FLANGE",
    "Axis",
    "Design",
    "Drawn",
    "Effect",
    "Regressor",
    "RobotModel",
    "StatedConditions",
    "check_effect",
    "conditions_at",
    "effect",
    "series_of",
]
