"""A step of a joint's zero: between two readings a joint slips by a constant angle, and stays so.

A belt that jumps a tooth, a coupling or a resolver that slips, a collision: of one joint alone, where `tool_shift` and
`base_shift` move all. The change point is the rank of the first reading after it; it is scanned.
"""

from __future__ import annotations

from functools import partial

from calib.effects.geometry.shift import change_points
from calib.effects.kind import Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import StepAt
from calib.scan.steps import Steps

KINDS = (
    Kind(
        "joint_step",
        words="jump in the zero of joint {joint}",
        check=(
            "Bring joint {joint} to its calibration mark and read the counter; look for a belt that jumped, "
            "a clamp that slipped, a collision between the two readings."
        ),
        apart=(),
        changed="Joint {joint} lost its zero by {size}.",
        remedy="Re-zero joint {joint} by {size}: where the controller shows 0 it stands at {size}.",
    ),
)


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


def changes(survey: Survey) -> list[Effect]:
    """The effects of a zero lost since a calibration, for every joint that moved, including the first."""
    return [joint_step(k, 0) for k in survey.moving]


def offer(survey: Survey) -> list[Steps]:
    """The candidates, a scan for each joint that moved; a step of joint 1 is one of the base about its axis, with
    fewer parameters."""
    ranks = change_points(survey)
    if not len(ranks):
        return []
    return [Steps(f"joint_step:j{k}", (f"theta{k}",), ranks, partial(joint_step, k)) for k in survey.moving]
