"""A step: the base or the tool is displaced between two readings, and stays displaced.

The change point is the rank of the first reading after the step; it is scanned. Source: a reflector turned in
its nest, a loosened clamp, a fork-lift against the pedestal. What creeps there instead is a rival of the step alone:
readings that do not show the moment bear out no jump.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from calib.array import Array
from calib.effects.kind import LATER, OTHER_STATION, SECOND_TARGET, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import CreepBetween, Regressor, StepAt
from calib.scan.steps import Steps

_AXES = ("x", "y", "z", "rx", "ry", "rz")
_SLOWLY = {
    "base": "The base or the instrument moved slowly from one reading to another.",
    "tool": "The tool moved slowly on the flange from one reading to another.",
}
_SETTLED_DEG = 0.03  # a foot of 500 mm that settles by a quarter of a millimetre on one side
_FEWEST = 6  # readings on either side of a step: fewer are outliers, not a change


KINDS = (
    Kind(
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
    Kind(
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
    Kind(
        "base_creep",
        words="base or instrument moving slowly",
        check="Check the feet of robot and instrument and the floor below; measure the nests between the poses.",
        apart=(LATER,),
    ),
    Kind(
        "tool_creep",
        words="tool moving slowly on the flange",
        check="Check clamp and bolts of the tool and the seats of its targets, and what warms or loads them.",
        apart=(LATER,),
    ),
)


def _moving(label: str, meaning: str, moves: Regressor, shape: dict[str, float], turn_deg: float) -> Effect:
    body = label.partition("_")[0]
    acts = {
        axis: ("mm", 0.5, [(f"{body}.{axis}", moves)])
        if len(axis) == 1
        else ("deg", turn_deg, [(f"{body}.{axis}", moves)])
        for axis in _AXES
    }
    return effect(label, "frames and tool", "mounting", meaning, acts, shape)


def _shift(name: str, meaning: str, rank: float, turn_deg: float = 0.1) -> Effect:
    return _moving(f"{name}_shift", meaning, StepAt(int(rank)), {"rank": float(int(rank))}, turn_deg)


def creep(name: str, rank: float, until: float) -> Effect:
    """Base or tool (`name`) creeps from the reading of `rank` to that of `until`; parameters as those of a step."""
    shape = {"rank": float(int(rank)), "until": float(int(until))}
    return _moving(f"{name}_creep", _SLOWLY[name], CreepBetween(int(rank), int(until)), shape, 0.1)


def base_shift(rank: float, turn_deg: float = 0.1) -> Effect:
    """The base steps before the reading of `rank`; parameters x, y, z (mm), rx, ry, rz (deg); turn_deg: usual turn."""
    return _shift("base", "The base, or the instrument, was moved between two readings.", rank, turn_deg)


def tool_shift(rank: float) -> Effect:
    """The tool steps before the reading of `rank`; parameters x, y, z (mm), rx, ry, rz (deg)."""
    return _shift("tool", "The tool was moved on the flange between two readings.", rank)


MAKERS = {"base_shift": base_shift, "tool_shift": tool_shift}


def changes(survey: Survey) -> list[Effect]:
    """The effects of a displaced tool, and of a base or an instrument that moved, since a calibration."""
    del survey  # whatever is measured
    return [tool_shift(0), base_shift(0, _SETTLED_DEG)]


def _family(label: str, ranks: Array) -> Steps:
    """The scan of one kind of step over some change points."""
    body = label.removesuffix("_shift")
    slots = tuple(f"{body}.{axis}" for axis in _AXES)
    return Steps(label, slots, ranks, MAKERS[label], partial(creep, body))


def change_points(survey: Survey) -> Array:
    """Every rank at which a visit begins and that leaves enough readings on either side."""
    order, visit = survey.conditions.order, survey.conditions.visit
    in_time = np.argsort(order)
    begins = np.diff(visit[in_time], prepend=-1) != 0
    return order[in_time][_FEWEST:-_FEWEST][begins[_FEWEST:-_FEWEST]]


def offer(survey: Survey) -> list[Steps]:
    """The candidates, steps of the base and of the tool at every change point."""
    ranks = change_points(survey)
    if not len(ranks):
        return []
    return [_family(label, ranks) for label in MAKERS]
