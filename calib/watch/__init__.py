"""Watch of a calibrated robot: whether and how it has changed, and what to do."""

from calib.watch.baseline import too_few_poses
from calib.watch.cause import Size, in_display
from calib.watch.history import append, baseline_hash, read_history
from calib.watch.judge import RATE, WatchVerdict, judge
from calib.watch.nests import NestLimit, nest_limit
from calib.watch.planning.plan import WatchPlan, judged, plan
from calib.watch.planning.planned import PlannedVisits, planned, within_stroke
from calib.watch.planning.rounds import REPEATS, TIMES, WatchPlanProposal, proposals
from calib.watch.planning.sizes import ALONE, SEEN, WANTED, DetectableSizes, SmallestDetected, seen_from
from calib.watch.refusals import missing, refuse_copies, refuse_unlike
from calib.watch.thermal import ThermalUpdate, cause_to_update, keep_up, later, updated, warms_up
from calib.watch.update_uncertainty import DOUBTFUL, times_as_uncertain
from calib.watch.whitened_readings import CheckPoseErrors, WhitenedReadings, missed

__all__ = [
    "ALONE",
    "DOUBTFUL",
    "RATE",
    "REPEATS",
    "SEEN",
    "TIMES",
    "WANTED",
    "CheckPoseErrors",
    "DetectableSizes",
    "NestLimit",
    "PlannedVisits",
    "Size",
    "SmallestDetected",
    "ThermalUpdate",
    "WatchPlan",
    "WatchPlanProposal",
    "WatchVerdict",
    "WhitenedReadings",
    "append",
    "baseline_hash",
    "cause_to_update",
    "in_display",
    "judge",
    "judged",
    "keep_up",
    "later",
    "missed",
    "missing",
    "nest_limit",
    "plan",
    "planned",
    "proposals",
    "read_history",
    "refuse_copies",
    "refuse_unlike",
    "seen_from",
    "times_as_uncertain",
    "too_few_poses",
    "updated",
    "warms_up",
    "within_stroke",
]
