"""The model: effects acting on the slots of the chain, what drives them, and what readings see of it."""

from calib.model.axis import Drawn
from calib.model.check import check_effect
from calib.model.effect import Effect, effect
from calib.model.model import Design, RobotModel
from calib.model.regressors import (
    Constant,
    Cosine,
    JointAngle,
    Side,
    Sine,
)
from calib.model.stated import StatedConditions, conditions_at

__all__ = [
    "Constant",
    "Cosine",
    "Design",
    "Drawn",
    "Effect",
    "JointAngle",
    "RobotModel",
    "Side",
    "Sine",
    "StatedConditions",
    "check_effect",
    "conditions_at",
    "effect",
]
