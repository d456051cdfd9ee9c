"""The closed loop: measure, find unmodelled errors, drive corrected targets, measure again."""

from acquisition.loop import rehearsal
from acquisition.loop.calibration import VERIFICATION, Outlook, calibration_campaign
from acquisition.loop.follow_up_campaign import campaign_table, campaign_text, fits, in_cell
from acquisition.loop.loop import (
    Compute,
    Equipment,
    FollowUpResult,
    LoopEnded,
    LoopResult,
    Say,
    Targets,
    close_loop,
    diagnosed,
)
from acquisition.loop.proof import ProofPlan, clock_of, plan_of_proof, prove, usable_here
from acquisition.loop.rehearsal import targets_csv

__all__ = [
    "VERIFICATION",
    "Compute",
    "Equipment",
    "FollowUpResult",
    "LoopEnded",
    "LoopResult",
    "Outlook",
    "ProofPlan",
    "Say",
    "Targets",
    "calibration_campaign",
    "campaign_table",
    "campaign_text",
    "clock_of",
    "close_loop",
    "diagnosed",
    "fits",
    "in_cell",
    "plan_of_proof",
    "prove",
    "rehearsal",
    "targets_csv",
    "usable_here",
]
