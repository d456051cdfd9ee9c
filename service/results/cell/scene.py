"""The cell as a picture needs it: arm and tool in one posture, what they must not touch, nests and targets.

Lengths mm, world frame; angles deg, as the controller counts them. Numbers are rounded to 0.1 mm: nobody sees less.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from acquisition.cell import Box, Cell, FloorObstacle, Obstacle, Post, home_of, targets_at
from calib.errors import DataError

FORMAT = "truepose-scene/1"


def scene_of(cell: Cell, joints_deg: Sequence[float] = ()) -> dict[str, Any]:
    """The scene with the robot in a posture (N,); without one at home, or in the middle of its limits.

    Raises DataError for a posture that this robot cannot have.
    """
    low, high = np.array(cell.robot.limits_deg).T
    posture = tuple(joints_deg) or home_of(cell) or tuple(((low + high) / 2.0).tolist())
    if len(posture) != len(low) or not np.all(np.isfinite(posture)):
        raise DataError(
            f"has {len(posture)} joint angles.", do=f"Give {len(low)} numbers, deg.", key="joints_deg"
        )
    joints = np.array([posture])
    arm = cell.clearance.arm
    targets = targets_at(cell, joints)[0]
    return {
        "format": FORMAT,
        "joints_deg": list(posture),
        "limits_deg": [list(pair) for pair in cell.robot.limits_deg],
        "capsules": [
            {
                "name": capsule.name,
                "link": capsule.link,
                "from_mm": _rounded(ends[0]),
                "to_mm": _rounded(ends[1]),
                "radius_mm": capsule.radius_mm,
            }
            for capsule, ends in zip(arm.capsules, arm.lines(joints)[0], strict=True)
        ],
        "obstacles": [
            shape
            for each in (FloorObstacle(cell.robot.table_z_mm), *cell.robot.keep_out, *cell.fixtures)
            if (shape := _shape(each)) is not None
        ],
        "nests_mm": {name: list(place) for name, place in cell.nests.items()},
        "targets_mm": {name: _rounded(place) for name, place in zip(cell.tool.targets, targets, strict=True)},
        "tool_mm": {name: list(place) for name, place in cell.tool.targets.items()},
        "station_mm": None if cell.instrument.declared.measures_lengths else list(cell.instrument.station_mm),
        "bar_mm": cell.instrument.nominal_mm if cell.instrument.declared.measures_lengths else None,
        "one_smr": cell.instrument.one_smr,
    }


def _shape(obstacle: Obstacle) -> dict[str, Any] | None:
    match obstacle:
        case FloorObstacle():
            return {"kind": "table", "name": "table", "z_mm": obstacle.z_mm}
        case Box():
            ends = {"low_mm": list(obstacle.low_mm), "high_mm": list(obstacle.high_mm)}
            return {"kind": "box", "name": obstacle.name, **ends}
        case Post():
            ends = {"from_mm": list(obstacle.from_mm), "to_mm": list(obstacle.to_mm)}
            return {"kind": "post", "name": obstacle.name, **ends, "radius_mm": obstacle.radius_mm}
        case _:
            return None


def _rounded(place: np.ndarray) -> list[float]:
    return [round(float(x), 1) for x in place]
