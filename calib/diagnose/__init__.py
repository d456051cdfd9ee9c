"""Diagnosis: effects missing from the base model, their evidence, and rival explanations."""

from calib.diagnose.carried import CarriedTerm, Shares
from calib.diagnose.diagnosis import CarryOver, DiagnosedEffect, DiagnosisFit, carry_over, diagnose
from calib.diagnose.follow_up import (
    APPROACHES,
    POSES,
    SEPARATES,
    FollowUp,
    Rivals,
    later_visits,
    next_measurements,
    separating,
)
from calib.diagnose.found import COVERAGE, DetectableEffect, HeldOutTest, errors_without
from calib.diagnose.select import MOST_EFFECTS
from calib.diagnose.structure import (
    ACTS_ON,
    EACH_POSE,
    QUICK,
    SEEN,
    TOGETHER,
    ResidualStructure,
    pauses,
    sight_at_tool,
)

__all__ = [
    "ACTS_ON",
    "APPROACHES",
    "COVERAGE",
    "EACH_POSE",
    "MOST_EFFECTS",
    "POSES",
    "QUICK",
    "SEEN",
    "SEPARATES",
    "TOGETHER",
    "CarriedTerm",
    "CarryOver",
    "DetectableEffect",
    "DiagnosedEffect",
    "DiagnosisFit",
    "FollowUp",
    "HeldOutTest",
    "ResidualStructure",
    "Rivals",
    "Shares",
    "carry_over",
    "diagnose",
    "errors_without",
    "later_visits",
    "next_measurements",
    "pauses",
    "separating",
    "sight_at_tool",
]
