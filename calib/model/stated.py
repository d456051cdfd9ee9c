"""The conditions for which a correction holds, and the robot's conditions at any joint angles under them.

A corrected target is valid only for the approach, temperature and time for which it was computed. Conditions that
follow from the joints (gravity torque, the joints before the last move) are computed for every pose of the iteration;
stated ones (side of approach, temperature, time, "after the last step") stay.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.arm.kinematics import forward, statics
from calib.arm.robot import Load
from calib.array import Array
from calib.data.conditions import Conditions
from calib.model.model import RobotModel
from calib.units import DEG

FLANGE = ""
"""The tool point of the flange itself; no target can have this name."""

AFTER_EVERYTHING = 1e12
"""Rank of a reading behind every step of the campaign."""


@dataclass(frozen=True)
class StatedConditions:
    """Conditions that hold for every target of a correction.

    side: per joint +1 from below (angle growing), -1 from above, one for each joint or one for all; approach: how
    far before the target the last move begins, rad, one for all joints or one for each; temperature_c: air; time_s:
    since the start of the campaign (NaN: not stated; effects that need it then refuse); loads: None for the robot's
    own; gravity in the base frame, m/s2; series: which set-up of base and tool, None for the only one.
    """

    side: tuple[float, ...] | float = 1.0
    approach: tuple[float, ...] | float = 5.0 * DEG
    temperature_c: float = np.nan
    time_s: float = np.nan
    order: float = AFTER_EVERYTHING
    loads: tuple[Load, ...] | None = None
    gravity: tuple[float, float, float] = (0.0, 0.0, -9.81)
    series: str | None = None


def series_of(model: RobotModel, stated: StatedConditions) -> str:
    """The series that is meant. Raises ValueError when it is unknown, or not named and there are several."""
    names = tuple(model.targets)
    if stated.series is None and len(names) == 1:
        return names[0]
    if stated.series not in names:
        raise ValueError(f"series {stated.series!r} is not one of {', '.join(names)}")
    return stated.series


def tool_point(model: RobotModel, series: str, target: str) -> Array:
    """(3,) nominal tool point in the flange frame, mm. Raises ValueError for an unknown target."""
    if target == FLANGE:
        return np.zeros(3)
    known = model.targets[series]
    if target not in known:
        raise ValueError(f"target {target!r} is not one of {', '.join(known)}")
    return np.array(known[target], dtype=np.float64)


def nominal_poses(model: RobotModel, joints: Array, tool: Array) -> Array:
    """(n, 4, 4) poses of the nominal robot's tool point, base frame, mm; joints (n, N) rad, tool (3,) mm."""
    poses = forward(model.robot, joints)
    poses[:, :3, 3] += poses[:, :3, :3] @ tool
    return poses


def conditions_at(
    model: RobotModel, joints: Array, stated: StatedConditions, target: str = FLANGE
) -> Conditions:
    """The conditions of n poses of the robot at model angles `joints` (n, N), rad, as stated.

    Raises ValueError for an unknown series or target, or sides that are not one a joint.
    """
    n, count = joints.shape
    series = series_of(model, stated)
    side = np.asarray(stated.side, dtype=np.float64)
    if side.shape not in ((), (count,)) or not np.all(np.isin(side, (-1.0, 1.0))):
        raise ValueError(f"side is {stated.side!r}; give +1 or -1, for all joints or for each of {count}")
    sides = np.broadcast_to(side, (n, count)).copy()
    tool = tool_point(model, series, target)
    target_names = (FLANGE, *model.targets[series])
    loading = statics(model.robot, joints, stated.loads, stated.gravity)
    place = model.placements.get(series, np.eye(4))
    return Conditions(
        joints=joints,
        earlier=np.zeros_like(joints),
        previous=joints - sides * np.asarray(stated.approach) * model.robot.steps,
        side=sides,
        torque=loading.torque,
        moment=loading.moment,
        overturning=loading.overturning,
        unit_load=loading.unit_load,
        time=np.full(n, stated.time_s),
        order=np.full(n, stated.order),
        temperature=np.full(n, stated.temperature_c),
        point=nominal_poses(model, joints, tool)[:, :3, 3] @ place[:3, :3].T + place[:3, 3],
        series=np.full(n, tuple(model.targets).index(series)),
        target=np.full(n, target_names.index(target)),
        anchor=np.full(n, -1),
        waypoint=np.full(n, -1),
        visit=np.arange(n),
        series_names=tuple(model.targets),
        target_names=target_names,
        axis_names=model.robot.axes,
        unit_names=model.robot.units,
    )
