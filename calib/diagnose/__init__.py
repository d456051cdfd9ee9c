"""The diagnosis: effects that the base model lacks, each with its evidence and the rivals that fit nearly as well."""

from calib.diagnose.advice import next_measurements
from calib.diagnose.carried import CarriedTerm, Shares
from calib.diagnose.carry import CarryOver, carry_over
from calib.diagnose.diagnosis import Diagnosis, Found, diagnose
from calib.diagnose.follow_up import APPROACHES, POSES, SEPARATES, FollowUp, Rivals, later_visits, separating
from calib.diagnose.named import COVERAGE
from calib.diagnose.outlying import ACTS_ON
from calib.diagnose.patch import Patch, error_with_patch, error_without_patch, patch_of
from calib.diagnose.places import QUICK, SEEN, TOGETHER, pauses, sight_at_tool
from calib.diagnose.power import Visible
from calib.diagnose.repeats import EACH_POSE
from calib.diagnose.select import MOST_EFFECTS
from calib.diagnose.structure import Structure
from calib.diagnose.surprise import Surprise
from calib.diagnose.without import errors_without

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
    "Diagnosis",
    "FollowUp",
    "Found",
    "Patch",
    "Rivals",
    "Shares",
    "Structure",
    "Surprise",
    "Visible",
    "carry_over",
    "diagnose",
    "error_with_patch",
    "error_without_patch",
    "errors_without",
    "later_visits",
    "next_measurements",
    "patch_of",
    "pauses",
    "separating",
    "sight_at_tool",
]
