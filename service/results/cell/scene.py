"""The cell as a picture needs it: arm and tool in one posture, obstacles, nests and targets.

Lengths are in mm, in the world frame, and angles in deg, as the controller counts them. Numbers are rounded to 0.1
mm, because no one sees less.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any

import numpy as np

from acquisition.cell import Box, Cell, FloorObstacle, Obstacle, Post, home_of, targets_at
from calib.errors import DataError
from service.results.shape import ResponseBody, told

_POINT = [412.3, -120.5, 655.0]
Place = Annotated[list[float], told("x, y, z in the world frame, mm.", _POINT)]


class CapsuleShown(ResponseBody):
    """A part of arm or tool: all points within a radius of a line."""

    name: Annotated[str, told("The part.", "forearm")]
    link: Annotated[int, told("Number of the link with which it moves, from 1 on.", 4)]
    from_mm: Place
    to_mm: Place
    radius_mm: Annotated[float, told("Its radius, mm.", 65.0)]


class ObstacleShown(ResponseBody):
    """An obstacle: a table (height), a box (two corners), or a post (two ends and a radius)."""

    kind: Annotated[str, told("table, box or post.", "box")]
    name: Annotated[str, told("Its name in the cell file.", "keep-out box 1")]


class SceneShown(ResponseBody):
    """A cell as a picture needs it."""

    format: Annotated[str, told("Name of this format.", "truepose-scene/1")]
    joints_deg: Annotated[
        list[float], told("The posture that is shown, deg.", [0.0, 20.0, -30.0, 0.0, 45.0, 0.0])
    ]
    limits_deg: Annotated[
        list[list[float]], told("Lowest and highest angle of every joint, deg.", [[-90.0, 90.0]])
    ]
    capsules: Annotated[list[CapsuleShown], told("Arm and tool in that posture.", [])]
    obstacles: Annotated[list[ObstacleShown], told("Table, boxes and posts.", [])]
    nests_mm: Annotated[
        dict[str, list[float]],
        told("Where the nests, or balls on the base, are, mm.", {"N1": [0.0, 0.0, 0.0]}),
    ]
    targets_mm: Annotated[
        dict[str, list[float]],
        told("Where the targets of the tool are in that posture, mm.", {"T1": _POINT}),
    ]
    tool_mm: Annotated[
        dict[str, list[float]], told("The targets in the flange frame, mm.", {"T1": [0.0, 0.0, 125.0]})
    ]
    station_mm: Annotated[
        list[float] | None,
        told("Where the instrument stands, mm; null of a ballbar.", [2400.0, -900.0, 350.0]),
    ]
    bar_mm: Annotated[float | None, told("Length of the ballbar, mm; null of other instruments.", 300.0)]
    one_smr: Annotated[bool, told("Whether a person moves the only SMR.", False)]


def scene_of(cell: Cell, joints_deg: Sequence[float] = ()) -> SceneShown:
    """Create the scene with the robot in a posture (N,), deg.

    Without a posture, the robot is at home, or in the middle of its limits.

    Raises
    ------
    DataError
        The robot cannot have this posture.
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
    return SceneShown(
        format="truepose-scene/1",
        joints_deg=list(posture),
        limits_deg=[list(pair) for pair in cell.robot.limits_deg],
        capsules=[
            CapsuleShown(
                name=capsule.name,
                link=capsule.link,
                from_mm=_rounded(ends[0]),
                to_mm=_rounded(ends[1]),
                radius_mm=capsule.radius_mm,
            )
            for capsule, ends in zip(arm.capsules, arm.lines(joints)[0], strict=True)
        ],
        obstacles=[
            ObstacleShown.model_validate(shape)
            for each in (FloorObstacle(cell.robot.table_z_mm), *cell.robot.boxes, *cell.fixtures)
            if (shape := _shape(each)) is not None
        ],
        nests_mm={name: list(place) for name, place in cell.nests.items()},
        targets_mm={name: _rounded(place) for name, place in zip(cell.tool.targets, targets, strict=True)},
        tool_mm={name: list(place) for name, place in cell.tool.targets.items()},
        station_mm=None if cell.instrument.declared.measures_lengths else list(cell.instrument.station_mm),
        bar_mm=cell.instrument.nominal_mm if cell.instrument.declared.measures_lengths else None,
        one_smr=cell.instrument.one_smr,
    )


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
