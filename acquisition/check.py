"""The whole plan is checked before the first motion: limits, and what arm and tool may not touch.

A pose that fails refuses the campaign (exit code 5) and is named; nothing has moved. The approach point is a
pose like any other: 5 deg beside a legal pose it can leave the limits or touch the table. From every pose there must be
a clear way to the approach point of the next; what is driven in another order is looked at again before it is driven.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquisition.cell import Cell
from acquisition.errors import NoClearWay, UnsafePlan
from acquisition.plan import Visit
from acquisition.transit import Transit, clear_ways


def check_plan(cell: Cell, visits: Sequence[Visit]) -> None:
    """Raises UnsafePlan naming the first pose that may not be driven, and why."""
    standing = [visit for visit in visits if visit.kind == "pose"]
    if not standing:
        return
    home = cell.robot.home_deg
    if home is not None and (contact := cell.clearance.at(np.array([home]))[0]) is not None:
        raise _unsafe(f"home_deg of the cell file: {contact}")
    for what, joints in (
        ("", np.array([visit.joints_deg for visit in standing])),
        ("the approach point of ", np.array([visit.approach_deg for visit in standing])),
    ):
        _within_limits(cell, standing, joints, what)
        for visit, angles, contact in zip(standing, joints, cell.clearance.at(joints), strict=True):
            if contact is not None:
                raise _unsafe(f"{what}{visit.name} ({_angles(angles)}): {contact}")
    _ways(cell, standing)


def _ways(cell: Cell, standing: Sequence[Visit]) -> None:
    poses = np.array([visit.joints_deg for visit in standing])
    approaches = np.array([visit.approach_deg for visit in standing])
    for visit, contact in zip(standing, cell.clearance.contacts(approaches, poses), strict=True):
        if contact is not None:
            raise _unsafe(f"the last move to {visit.name} ({_angles(visit.joints_deg)}): {contact.during}")
    transit = Transit(cell)
    for i in np.flatnonzero(~clear_ways(cell, poses[:-1], approaches[1:])).tolist():
        try:
            transit.way(poses[i], approaches[i + 1])
        except NoClearWay as error:
            there = f"{standing[i + 1].name} ({_angles(poses[i + 1])})"
            raise _unsafe(f"between {standing[i].name} and {there}: {error.message}") from error


def _unsafe(what: str) -> UnsafePlan:
    return UnsafePlan(what, command="check")


def _within_limits(cell: Cell, standing: Sequence[Visit], joints: np.ndarray, what: str) -> None:
    low, high = np.array(cell.robot.limits_deg).T
    outside = ~((joints >= low) & (joints <= high))  # NaN is outside
    if outside.any():
        i, k = (int(index) for index in np.argwhere(outside)[0])
        raise UnsafePlan(
            f"{what}{standing[i].name}: joint {k + 1} at {joints[i, k]:g} deg, "
            f"allowed {low[k]:g} to {high[k]:g}",
            command="check",
        )


def _angles(joints: Sequence[float] | np.ndarray) -> str:
    return ", ".join(f"{q:g}" for q in joints) + " deg"
