"""The whole plan is checked before the first motion: limits, table, keep-out boxes, of poses, approach points and ways.

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
from acquisition.workspace import above_table, may_stand, outside_boxes, points_of_arm


def check_plan(cell: Cell, visits: Sequence[Visit]) -> None:
    """Raises UnsafePlan naming the first pose that may not be driven, and why."""
    standing = [visit for visit in visits if visit.kind == "pose"]
    if not standing:
        return
    home = cell.robot.home_deg
    if home is not None and not may_stand(cell, np.array([home]))[0]:
        raise UnsafePlan(
            "home_deg of the cell file brings arm or tool too low or into a box", command="check"
        )
    for what, joints in (
        ("", np.array([visit.joints_deg for visit in standing])),
        ("the approach point of ", np.array([visit.approach_deg for visit in standing])),
    ):
        _within_limits(cell, standing, joints, what)
        points = points_of_arm(cell, joints)
        for good, why in (
            (above_table(cell, points), f"lower than table_z_mm = {cell.robot.table_z_mm:g}"),
            (outside_boxes(cell, points), "inside a keep-out box"),
        ):
            if not good.all():
                i = int(np.argmin(good))
                raise UnsafePlan(
                    f"{what}{standing[i].name} ({_angles(joints[i])}) brings arm or tool {why}",
                    command="check",
                )

    _ways(cell, standing)


def _ways(cell: Cell, standing: Sequence[Visit]) -> None:
    poses = np.array([visit.joints_deg for visit in standing])
    approaches = np.array([visit.approach_deg for visit in standing])
    for i in np.flatnonzero(~clear_ways(cell, approaches, poses)).tolist():
        raise _in_the_way(cell, f"the last move to {standing[i].name} ({_angles(poses[i])})")
    transit = Transit(cell)
    for i in np.flatnonzero(~clear_ways(cell, poses[:-1], approaches[1:])).tolist():
        try:
            transit.way(poses[i], approaches[i + 1])
        except NoClearWay as error:
            what = f"every way from {standing[i].name} to {standing[i + 1].name} ({_angles(poses[i + 1])})"
            raise _in_the_way(cell, what) from error


def _in_the_way(cell: Cell, what: str) -> UnsafePlan:
    limit = f"lower than table_z_mm = {cell.robot.table_z_mm:g} or into a keep-out box"
    return UnsafePlan(f"{what} brings arm or tool {limit}", command="check")


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


def _angles(joints: np.ndarray) -> str:
    return ", ".join(f"{q:g}" for q in joints) + " deg"
