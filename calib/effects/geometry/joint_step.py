"""A step of a joint's zero: between two readings a joint slips by a constant angle, and stays so.

A belt that jumps a tooth, a coupling or a resolver that slips, a collision: of one joint alone, where `tool_shift` and
`base_shift` move all. The change point is the rank of the first reading after it; it is scanned. A zero that creeps
meanwhile is its rival alone: readings that do not show the moment bear out no jump.
"""

from __future__ import annotations

from functools import partial

from calib.effects.geometry.shift import change_points
from calib.effects.kind import LATER, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import CreepBetween, Regressor, StepAt
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
    Kind(
        "joint_creep",
        words="zero of joint {joint} creeping",
        check="Look for a clamp that slips or a brake that gives way at joint {joint}, and for what warms it.",
        apart=(LATER,),
    ),
)


def joint_step(joint: int, rank: float) -> Effect:
    """The zero of `joint` steps before the reading of `rank`; parameter step, deg."""
    meaning = f"The zero of joint {joint} jumped between two readings."
    return _moving(f"joint_step:j{joint}", meaning, joint, StepAt(int(rank)), {"rank": float(int(rank))})


def joint_creep(joint: int, rank: float, until: float) -> Effect:
    """The zero of `joint` creeps from the reading of `rank` to that of `until`; parameter step, deg."""
    meaning = f"The zero of joint {joint} crept away from one reading to another."
    shape = {"rank": float(int(rank)), "until": float(int(until))}
    return _moving(f"joint_creep:j{joint}", meaning, joint, CreepBetween(int(rank), int(until)), shape)


def _moving(label: str, meaning: str, joint: int, moves: Regressor, shape: dict[str, float]) -> Effect:
    acts = {"step": ("deg", 0.1, [(f"theta{joint}", moves)], (-5.0, 5.0))}
    return effect(label, "transmission", "robot", meaning, acts, shape)


def changes(survey: Survey) -> list[Effect]:
    """The effects of a zero lost since a calibration, for every joint that moved, including the first."""
    return [joint_step(k, 0) for k in survey.moving]


def offer(survey: Survey) -> list[Steps]:
    """The candidates, a scan for each joint that moved; a step of joint 1 is one of the base about its axis, with
    fewer parameters."""
    ranks = change_points(survey)
    if not len(ranks):
        return []
    return [
        Steps(f"joint_step:j{k}", (f"theta{k}",), ranks, partial(joint_step, k), partial(joint_creep, k))
        for k in survey.moving
    ]
