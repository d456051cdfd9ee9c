"""Model of a robot: effects on its kinematic chain, regressors and predicted readings."""

from calib.model.axis import Axis, PlotAxis
from calib.model.effect import Effect, EffectTerm, effect
from calib.model.model import (
    FLANGE,
    BoundModel,
    ModelStructure,
    StatedConditions,
    check_effect,
    conditions_at,
    conditions_of,
    named_only,
    series_of,
)
from calib.model.regressors import InSeries, OnTarget, Regressor, ToAnchor

__all__ = [
    "FLANGE",
    "Axis",
    "BoundModel",
    "Effect",
    "EffectTerm",
    "InSeries",
    "ModelStructure",
    "OnTarget",
    "PlotAxis",
    "Regressor",
    "StatedConditions",
    "ToAnchor",
    "check_effect",
    "conditions_at",
    "conditions_of",
    "effect",
    "named_only",
    "series_of",
]
