"""Effects of geometry: zeros, axes, the tool on the flange, and steps between two readings.

The change point of a step is the rank of the first reading after it; it is scanned. A creep instead of a step is a
rival only of that step: readings that do not show the moment do not confirm a jump.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from calib.array import Array
from calib.effects.kind import LATER, OTHER_STATION, SECOND_TARGET, EffectKind, EffectModule, Row
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant, CreepBetween, OnTarget, Regressor, StepAt
from calib.scan.families import Candidate, Steps

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_SETTLED_DEG = 0.03  # a foot of 500 mm that settles by a quarter of a millimetre on one side
_SLOWLY = {
    "base": "The base or the instrument moved slowly from one reading to another.",
    "tool": "The tool moved slowly on the flange from one reading to another.",
}
_FEWEST = 6  # fewest readings on either side of a step: fewer are outliers, not a change


# The group `geometry` contains it as theta_K. The zero of joint 1 is the turn of the base about z, which every model
# frees.
joint_offset = Row(
    EffectKind(
        "joint_offset",
        words="zero of joint {joint}",
        check="Bring joint {joint} to its calibration mark and read the counter; master the axis anew if it is off.",
        apart=(),
    ),
    law="Joint offset: the zero of a joint is off by a constant angle; the group `geometry` contains it as theta_K.",
    means="The zero of joint {joint} is off.",
    parameter="offset",
    unit="deg",
    size=0.3,
    slot="theta",
    regressor=lambda joint: Constant(),
    where=lambda survey: [k for k in survey.moving if k > 1],
)

# On other links the DH parameters contain it. Source: Hayati 1983.
parallel_twist = Row(
    EffectKind(
        "parallel_twist",
        words="twisted axes at link {joint}",
        check=(
            "Nothing to repair: the axes at link {joint} were machined so; look for a past collision if the "
            "value has changed since the last calibration."
        ),
        apart=(),
    ),
    law="Parallel twist: two axes that are parallel by design are not, Hayati's beta of link K.",
    means="The axes that link {joint} should hold parallel are twisted.",
    parameter="beta",
    unit="deg",
    size=0.1,
    slot="beta",
    regressor=lambda link: Constant(),
    where=lambda survey: survey.robot.parallel_axes,
    group="structure",
)


def joint_step(joint: int, rank: float) -> Effect:
    """Build a step of a joint's zero before the reading of `rank`; parameter step, deg."""
    meaning = f"The zero of joint {joint} jumped between two readings."
    return _slipping(f"joint_step:j{joint}", meaning, joint, StepAt(int(rank)), {"rank": float(int(rank))})


def joint_creep(joint: int, rank: float, until: float) -> Effect:
    """Build a creep of a joint's zero from reading `rank` to `until`; parameter step, deg."""
    meaning = f"The zero of joint {joint} crept away from one reading to another."
    shape = {"rank": float(int(rank)), "until": float(int(until))}
    return _slipping(f"joint_creep:j{joint}", meaning, joint, CreepBetween(int(rank), int(until)), shape)


def _slipping(label: str, meaning: str, joint: int, moves: Regressor, shape: dict[str, float]) -> Effect:
    acts = {"step": ("deg", 0.1, [(f"theta{joint}", moves)], (-5.0, 5.0))}
    return effect(label, "transmission", "robot", meaning, acts, shape)


def _offer_joint_step(survey: Survey) -> list[Steps]:
    """Offer a scan for each joint that moved.

    A step of joint 1 is a step of the base about its axis, which has fewer parameters.
    """
    ranks = change_points(survey)
    if not len(ranks):
        return []
    return [
        Steps(f"joint_step:j{k}", (f"theta{k}",), ranks, partial(joint_step, k), partial(joint_creep, k))
        for k in survey.moving
    ]


def _displaced(
    label: str, meaning: str, moves: Regressor, shape: dict[str, float], turn_deg: float
) -> Effect:
    body = label.partition("_")[0]
    acts = {
        axis: ("mm", 0.5, [(f"{body}.{axis}", moves)])
        if len(axis) == 1
        else ("deg", turn_deg, [(f"{body}.{axis}", moves)])
        for axis in _AXES
    }
    return effect(label, "frames and tool", "mounting", meaning, acts, shape)


def _shift(name: str, meaning: str, rank: float, turn_deg: float = 0.1) -> Effect:
    return _displaced(f"{name}_shift", meaning, StepAt(int(rank)), {"rank": float(int(rank))}, turn_deg)


def creep(name: str, rank: float, until: float) -> Effect:
    """Build a creep of base or tool (`name`) between the readings `rank` and `until`.

    The parameters are those of a step.
    """
    shape = {"rank": float(int(rank)), "until": float(int(until))}
    return _displaced(f"{name}_creep", _SLOWLY[name], CreepBetween(int(rank), int(until)), shape, 0.1)


def base_shift(rank: float, turn_deg: float = 0.1) -> Effect:
    """Build a step of the base before the reading of `rank`.

    The parameters are x, y, z (mm), rx, ry, rz (deg). The usual turn is `turn_deg`.
    """
    return _shift("base", "The base, or the instrument, was moved between two readings.", rank, turn_deg)


def tool_shift(rank: float) -> Effect:
    """Build a step of the tool before the reading of `rank`.

    The parameters are x, y, z (mm), rx, ry, rz (deg).
    """
    return _shift("tool", "The tool was moved on the flange between two readings.", rank)


def change_points(survey: Survey) -> Array:
    """Return every rank at which a step may occur.

    A visit begins there, the times of the two readings are known, and there are enough readings on either side. Without
    times the position in the file, which may be joined from several files, shows no moment.
    """
    order, visit = survey.conditions.order, survey.conditions.visit
    in_time = np.argsort(order)
    timed = np.isfinite(survey.conditions.time[in_time])
    begins = (np.diff(visit[in_time], prepend=-1) != 0) & timed & np.roll(timed, 1)
    return order[in_time][_FEWEST:-_FEWEST][begins[_FEWEST:-_FEWEST]]


def _offer_shift(survey: Survey) -> list[Steps]:
    """Offer steps of the base and of the tool at every change point."""
    ranks = change_points(survey)
    if not len(ranks):
        return []
    return [
        Steps(f"{body}_shift", tuple(f"{body}.{axis}" for axis in _AXES), ranks, step, partial(creep, body))
        for body, step in (("base", base_shift), ("tool", tool_shift))
    ]


def tool_offset() -> Effect:
    """Build a shift of all targets across the last axis; parameters x, y, mm."""
    return effect(
        "tool_offset",
        "frames and tool",
        "mounting",
        "The tool sits beside the axis of the flange.",
        {axis: ("mm", 0.5, [(f"tool.{axis}", Constant())]) for axis in "xy"},
    )


def tool_tilt() -> Effect:
    """Build a turn of all targets about a line across the last axis, through the flange.

    The parameters are rx and ry, deg.
    """
    return effect(
        "tool_tilt",
        "frames and tool",
        "mounting",
        "The tool is mounted askew on the flange.",
        {axis: ("deg", 0.2, [(f"tool.{axis}", Constant())]) for axis in ("rx", "ry")},
    )


def target_offset(target: str, series: Sequence[str]) -> Effect:
    """Build a shift of one target on the tool in all `series`.

    The parameters are x, y, z, mm, in the flange frame.
    """
    return effect(
        f"target_offset:{target}",
        "frames and tool",
        "mounting",
        f"Target {target} sits elsewhere on the tool than measured.",
        {
            axis: ("mm", 0.5, [(f"target.{axis}", OnTarget(name, target)) for name in series])
            for axis in "xyz"
        },
    )


def _offer_tool(survey: Survey) -> list[Candidate]:
    """Offer offset and tilt of the tool and a shift of each target.

    Nothing is offered if the base model frees the tool. A shift along the last axis is d of the last link, and a turn
    about it is theta. With one target a shift and a turn look the same.
    """
    if survey.frees_tool:
        return []
    conditions = survey.conditions
    candidates = [Candidate(tool_offset()), Candidate(tool_tilt())]
    for t in np.unique(conditions.target):
        seen_in = np.unique(conditions.series[conditions.target == t])
        series = [conditions.series_names[s] for s in seen_in]
        candidates.append(Candidate(target_offset(conditions.target_names[t], series)))
    return candidates


JOINT_STEP = EffectModule(
    "A step of a joint's zero: between two readings a joint slips by a constant angle, and stays so.",
    (
        EffectKind(
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
        EffectKind(
            "joint_creep",
            words="zero of joint {joint} creeping",
            check="Look for a clamp that slips or a brake that gives way at joint {joint}, and for what warms it.",
            apart=(LATER,),
        ),
    ),
    _offer_joint_step,
    lambda survey: [joint_step(k, 0) for k in survey.moving],
)
SHIFT = EffectModule(
    "A step: the base or the tool is displaced between two readings, and stays displaced.",
    (
        EffectKind(
            "base_shift",
            words="base or instrument moved",
            check=(
                "Look for what moved the robot's foot or the instrument's stand: anchor bolts, tripod feet, "
                "traffic; measure the nests again."
            ),
            apart=(OTHER_STATION,),
            changed="The base of the robot, or the frame of the instrument, moved: the arm's targets by {size}.",
            remedy=(
                "Measure the nests again; where it stays, re-teach the work frames or correct targets with the updated "
                "model."
            ),
        ),
        EffectKind(
            "tool_shift",
            words="tool moved on the flange",
            check=(
                "Look for what struck or loosened the tool: clamp, bolts, marks on the targets; the readings "
                "before and after belong to two tools."
            ),
            apart=(SECOND_TARGET,),
            changed="The tool moved on the flange: its targets by {size}.",
            remedy="Re-teach the tool, or correct targets with the updated model.",
        ),
        EffectKind(
            "base_creep",
            words="base or instrument moving slowly",
            check="Check the feet of robot and instrument and the floor below; measure the nests between the poses.",
            apart=(LATER,),
        ),
        EffectKind(
            "tool_creep",
            words="tool moving slowly on the flange",
            check="Check clamp and bolts of the tool and the seats of its targets, and what warms or loads them.",
            apart=(LATER,),
        ),
    ),
    _offer_shift,
    lambda survey: [tool_shift(0), base_shift(0, _SETTLED_DEG)],
)
TOOL = EffectModule(
    "Tool: its targets are not at their measured places on the flange: all shifted, all turned, or one shifted.",
    (
        EffectKind(
            "tool_offset",
            words="tool beside the axis of the flange",
            check="Check how the tool is centred on the flange: pin, collar, burrs; measure its targets anew.",
            apart=(SECOND_TARGET,),
        ),
        EffectKind(
            "tool_tilt",
            words="tool mounted askew",
            check="Clean the face between flange and tool, tighten its bolts evenly, and measure its targets anew.",
            apart=(SECOND_TARGET,),
        ),
        EffectKind(
            "target_offset",
            words="seat of target {name}",
            check="Check the seat of target {name} for dirt and looseness, and measure its place on the tool anew.",
            apart=(SECOND_TARGET,),
        ),
    ),
    _offer_tool,
)
