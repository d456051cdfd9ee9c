"""Compensation: targets that make the real robot land where the nominal one would. `correct` is the door."""

from calib.compensate.correct import Correction, Status, correct
from calib.compensate.stated import FLANGE, StatedConditions, conditions_at, nominal_poses

__all__ = [
    "FLANGE",
    "Correction",
    "StatedConditions",
    "Status",
    "conditions_at",
    "correct",
    "nominal_poses",
]
