"""The model of a robot: effects on the slots of its kinematic chain, their regressors, and the predicted readings."""

from calib.model.axis import Axis, Drawn
from calib.model.effect import Effect, Term, effect
from calib.model.model import (
    FLANGE,
    Design,
    RobotModel,
    StatedConditions,
    check_effect,
    conditions_at,
    named_only,
    series_of,
)
from calib.model.regressors import InSeries, OnTarget, Regressor, ToAnchor

__all__ = [
    "FLANGE",
    "Axis",
    "Design",
    "Drawn",
    "Effect",
    "InSeries",
    "OnTarget",
    "Regressor",
    "RobotModel",
    "StatedConditions",
    "Term",
    "ToAnchor",
    "check_effect",
    "conditions_at",
    "effect",
    "named_only",
    "series_of",
]
