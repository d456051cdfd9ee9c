"""A step of a joint's zero: between two readings a joint slips by a constant angle, and stays so.

A belt that jumps a tooth, a coupling or a resolver that slips, a collision: of one joint alone, where `tool_shift` and
`base_shift` move all. The change point is the rank of the first reading after it; it is scanned.
"""

from __future__ import annotations

from functools import partial

from calib.effects.effect import Effect, Steps, effect
from calib.effects.shift import change_points, coarse
from calib.effects.survey import Survey
from calib.regressors import StepAt


def joint_step(joint: int, rank: float) -> Effect:
    """The zero of `joint` steps before the reading of `rank`; parameter step, deg."""
    return effect(
        f"joint_step:j{joint}",
        "transmission",
        "robot",
        f"The zero of joint {joint} jumped between two readings.",
        {"step": ("deg", 0.1, [(f"theta{joint}", StepAt(int(rank)))], (-5.0, 5.0))},
        {"rank": float(int(rank))},
    )


def offer(survey: Survey) -> list[Steps]:
    """One scan a joint that moved; a step of joint 1 is one of the base about its axis, told by fewer parameters."""
    ranks = coarse(change_points(survey))
    if not len(ranks):
        return []
    return [Steps(f"joint_step:j{k}", (f"theta{k}",), ranks, partial(joint_step, k)) for k in survey.moving]
