"""Tool: its targets are not at their measured places on the flange: all shifted, all turned, or one shifted.

What shifts along the last axis or turns about it is d and theta of the last link. With one target a shift and a
turn look the same.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.effects.kind import SECOND_TARGET, Kind
from calib.effects.survey import Survey
from calib.model.effect import Effect, effect
from calib.model.regressors import Constant, OnTarget
from calib.scan.fixed import Candidate

KINDS = (
    Kind(
        "tool_offset",
        words="tool beside the axis of the flange",
        check="Check how the tool is centred on the flange: pin, collar, burrs; measure its targets anew.",
        apart=(SECOND_TARGET,),
    ),
    Kind(
        "tool_tilt",
        words="tool mounted askew",
        check=(
            "Clean the face between flange and tool, tighten its bolts evenly, and measure its targets anew."
        ),
        apart=(SECOND_TARGET,),
    ),
    Kind(
        "target_offset",
        words="seat of target {name}",
        check=(
            "Check the seat of target {name} for dirt and looseness, and measure its place on the tool anew."
        ),
        apart=(SECOND_TARGET,),
    ),
)


def tool_offset() -> Effect:
    """The effect of all targets shifted across the last axis; parameters x, y, mm."""
    return effect(
        "tool_offset",
        "frames and tool",
        "mounting",
        "The tool sits beside the axis of the flange.",
        {axis: ("mm", 0.5, [(f"tool.{axis}", Constant())]) for axis in "xy"},
    )


def tool_tilt() -> Effect:
    """The effect of all targets turned about a line across the last axis, through the flange; parameters rx, ry,
    deg."""
    return effect(
        "tool_tilt",
        "frames and tool",
        "mounting",
        "The tool is mounted askew on the flange.",
        {axis: ("deg", 0.2, [(f"tool.{axis}", Constant())]) for axis in ("rx", "ry")},
    )


def target_offset(target: str, series: Sequence[str]) -> Effect:
    """The effect of one target shifted on the tool in all `series`; parameters x, y, z, mm, flange frame."""
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


def offer(survey: Survey) -> list[Candidate]:
    """The candidates, offset and tilt of the tool and a shift of each target; none where the base model has them."""
    if survey.frees_tool:
        return []
    conditions = survey.conditions
    candidates = [Candidate(tool_offset()), Candidate(tool_tilt())]
    for t in np.unique(conditions.target):
        seen_in = np.unique(conditions.series[conditions.target == t])
        series = [conditions.series_names[s] for s in seen_in]
        candidates.append(Candidate(target_offset(conditions.target_names[t], series)))
    return candidates
