"""Benchmark of planning with clearance: moves past a post, and the time of 400 poses.

The time is that to draw and check the poses. No move that touches according to fine sampling may pass for clear,
and none that passes at 2 mm may be refused.
"""

from __future__ import annotations

import numpy as np

from acquisition.campaign.plan import check_plan, make_plan
from tests.acquisition.arm_reference import looked_at
from tests.acquisition.fakes import a_campaign, a_cell
from tests.benchmarks.clock import line, seconds

MOVES, LOOKS, POSES = 300, 1500, 400
POST = {"name": "post", "low_mm": [380.0, 80.0, 20.0], "high_mm": [480.0, 180.0, 600.0]}


def run() -> bool:
    """Print what was missed, refused without need, and the times."""
    cell = a_cell(fixture=[POST])
    low, high = np.array(cell.robot.limits_deg).T
    postures = np.random.default_rng(0).uniform(low, high, (20 * MOVES, len(low)))
    postures = postures[cell.clearance.clear_at(postures)][: 2 * MOVES]
    starts, goals = postures[0::2], postures[1::2]
    clear = cell.clearance.clear_between(starts, goals)
    nearest = np.array([looked_at(cell, a, b, LOOKS)[0] for a, b in zip(starts, goals, strict=True)])
    wrong, refused = int(np.sum(clear & (nearest < 0.0))), int(np.sum(~clear & (nearest > 2.0)))
    line(f"clearance: moves of {MOVES} that touch and pass for clear", str(wrong), "0", wrong == 0)
    line(f"clearance: moves of {MOVES} that pass by 2 mm and are refused", str(refused), "0", refused == 0)
    once = seconds(lambda: cell.clearance.clear_between(starts, goals))
    line("clearance: a move, ms", f"{1e3 * once / MOVES:.3f}", "", True)
    campaign = a_campaign(block=[{"count": POSES}])

    def plan() -> None:
        fresh = cell.model_copy()  # what a cell keeps is worked out anew
        check_plan(fresh, make_plan(fresh, campaign))

    line(f"clearance: {POSES} poses drawn and checked, s", f"{seconds(plan):.2f}", "", True)
    return wrong == 0 and refused == 0
