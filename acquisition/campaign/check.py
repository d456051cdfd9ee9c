"""The check of a whole plan before the first motion: limits, and what arm and tool may not touch.

A pose that fails refuses the campaign (exit code 5) and is named; nothing has moved. The approach point is a
pose like any other: 5 deg beside a legal pose it can leave the limits or touch the table. From every pose there must be
a clear path to the approach point of the next; what is driven in another order is looked at again before it is driven.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquisition.campaign.plan import Visit
from acquisition.cell.cell import Cell
from acquisition.cell.transit import Transit, clear_moves
from acquisition.errors import NoClearWay, UnsafePlan


def check_plan(cell: Cell, visits: Sequence[Visit]) -> None:
    """Check every pose of a plan. Raises UnsafePlan naming the first that may not be driven, and why."""
    stops = [stop for visit in visits if visit.kind == "pose" for stop in visit.stops]
    if not stops:
        return
    home = cell.robot.home_deg
    if home is not None and (contact := cell.clearance.at(np.array([home]))[0]) is not None:
        raise _unsafe(f"home_deg of the cell file: {contact}")
    for what, joints in (
        ("", np.array([visit.joints_deg for visit in stops])),
        ("the approach point of ", np.array([visit.approach_deg for visit in stops])),
    ):
        _within_limits(cell, stops, joints, what)
        for visit, angles, contact in zip(stops, joints, cell.clearance.at(joints), strict=True):
            if contact is not None:
                raise _unsafe(f"{what}{visit.name} ({cell.robot.said(angles)}): {contact}")
    _moves(cell, stops)


def _moves(cell: Cell, stops: Sequence[Visit]) -> None:
    poses = np.array([visit.joints_deg for visit in stops])
    approaches = np.array([visit.approach_deg for visit in stops])
    for visit, contact in zip(stops, cell.clearance.contacts(approaches, poses), strict=True):
        if contact is not None:
            raise _unsafe(
                f"the last move to {visit.name} ({cell.robot.said(visit.joints_deg)}): {contact.during}"
            )
    transit = Transit(cell)
    for i in np.flatnonzero(~clear_moves(cell, poses[:-1], approaches[1:])).tolist():
        try:
            transit.path(poses[i], approaches[i + 1])
        except NoClearWay as error:
            there = f"{stops[i + 1].name} ({cell.robot.said(poses[i + 1])})"
            raise _unsafe(f"between {stops[i].name} and {there}: {error.message}") from error


def _unsafe(what: str) -> UnsafePlan:
    return UnsafePlan(what, command="check")


def _within_limits(cell: Cell, stops: Sequence[Visit], joints: np.ndarray, what: str) -> None:
    low, high = np.array(cell.robot.limits_deg).T
    outside = ~((joints >= low) & (joints <= high))  # NaN is outside
    if outside.any():
        i, k = (int(index) for index in np.argwhere(outside)[0])
        raise UnsafePlan(
            f"{what}{stops[i].name}: {cell.robot.named(k)} at {joints[i, k]:g} {cell.robot.model.units[k]}, "
            f"allowed {low[k]:g} to {high[k]:g}",
            command="check",
        )
