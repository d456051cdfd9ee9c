"""The watch: is a robot still the one that was calibrated; what has changed, by how much, and what to do."""

from calib.watch.cause import Cause, Size, in_display
from calib.watch.history import History, append, baseline_hash, read_history
from calib.watch.judge import RATE, Question, Verdict, judge
from calib.watch.plan import FEWEST, Plan, plan
from calib.watch.planned import planned
from calib.watch.refusals import refuse_unlike
from calib.watch.seen import Seen
from calib.watch.sizes import ALONE, SEEN, Smallest
from calib.watch.update import as_updated, cause_to_update, updated

__all__ = [
    "ALONE",
    "FEWEST",
    "RATE",
    "SEEN",
    "Cause",
    "History",
    "Plan",
    "Question",
    "Seen",
    "Size",
    "Smallest",
    "Verdict",
    "append",
    "as_updated",
    "baseline_hash",
    "cause_to_update",
    "in_display",
    "judge",
    "plan",
    "planned",
    "read_history",
    "refuse_unlike",
    "updated",
]
