"""Which parts of arm and tool are above the table and outside the keep-out boxes, and which targets are seen.

The arm is taken as the straight lines between the origins of its link frames from the elbow on, and from the
flange to every target: points a few centimetres apart along them are looked at, on the nominal robot. It has
no thickness here; leave that as a margin in `table_z_mm` and the boxes. A target whose normal the cell declares is
seen within the cone that the instrument accepts. Lengths mm, angles deg.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from acquisition.cell import Cell
from calib.kinematics import Chain, Placement, forward, nominal_values, propagate
from calib.units import DEG

Array = NDArray[np.float64]
_ELBOW = 2  # frames before the elbow stand on the pedestal and never come near the table
_PER_SEGMENT, _PER_SEGMENT_BY_BOXES = (
    5,
    9,
)  # ends show where a straight part is lowest; a box may be smaller than it
_CONE_DEG = 30.0  # a corner cube in its ball (SMR) returns the beam up to this angle from its normal
_CONES_DEG = {"ctrack": 15.0}  # flat reflectors seen by cameras


def targets_at(cell: Cell, joints_deg: Array) -> Array:
    """(n, m, 3) mm: where the m targets are in the world for joint angles (n, N) of the controller, nominal robot."""
    poses = forward(cell.robot.model, cell.robot.model_angles(joints_deg))
    targets = np.array(list(cell.tool.targets.values()))
    return np.einsum("nij,mj->nmi", poses[:, :3, :3], targets) + poses[:, None, :3, 3]


def points_of_arm(cell: Cell, joints_deg: Array) -> Array:
    """(n, k, 3) mm: points along arm and tool that must stay clear."""
    joints = cell.robot.model_angles(joints_deg)
    robot = cell.robot.model
    frames = propagate(Chain.of(robot), nominal_values(robot, joints), Placement())
    origins = [np.broadcast_to(frame[3], (3, len(joints))).T for frame in frames.link_frames[_ELBOW:]]
    flange = origins[-1]
    segments = list(pairwise(origins))
    segments += [(flange, target) for target in targets_at(cell, joints_deg).transpose(1, 0, 2)]
    shares = np.linspace(0.0, 1.0, _PER_SEGMENT_BY_BOXES if cell.robot.keep_out_mm else _PER_SEGMENT)
    return np.concatenate(
        [start[:, None] + shares[None, :, None] * (end - start)[:, None] for start, end in segments], axis=1
    )


def above_table(cell: Cell, points: Array) -> NDArray[np.bool_]:
    """(n,) all points (n, k, 3) higher than the table."""
    return np.all(points[:, :, 2] > cell.robot.table_z_mm, axis=1)


def outside_boxes(cell: Cell, points: Array) -> NDArray[np.bool_]:
    """(n,) no point (n, k, 3) in a keep-out box."""
    inside = np.zeros(points.shape[:2], dtype=bool)
    for low, high in cell.robot.keep_out_mm:
        inside |= np.all((points > np.array(low)) & (points < np.array(high)), axis=2)
    return ~np.any(inside, axis=1)


def may_stand(cell: Cell, joints_deg: Array) -> NDArray[np.bool_]:
    """(n,) joint angles (n, N) within the limits, arm and tool clear of table and boxes."""
    low, high = np.array(cell.robot.limits_deg).T
    points = points_of_arm(cell, joints_deg)
    within = np.all((joints_deg >= low) & (joints_deg <= high), axis=1)
    return within & above_table(cell, points) & outside_boxes(cell, points)


def cone_deg(cell: Cell) -> float:
    """Largest angle between a target's normal and the direction to the instrument at which the target is seen."""
    return _CONES_DEG.get(cell.instrument.driver, _CONE_DEG)


def facing(cell: Cell, joints_deg: Array, targets: Sequence[str]) -> NDArray[np.bool_]:
    """(n,) whether those of `targets` that have a normal look at the instrument, within its cone."""
    poses = forward(cell.robot.model, cell.robot.model_angles(joints_deg))
    seen = np.ones(len(poses), dtype=bool)
    for name in targets:
        if name not in cell.tool.normals:
            continue
        normal = np.array(cell.tool.normals[name])
        place = poses[:, :3, :3] @ np.array(cell.tool.targets[name]) + poses[:, :3, 3]
        beam = np.array(cell.instrument.station_mm) - place
        along = np.sum((poses[:, :3, :3] @ normal) * beam, axis=1)
        seen &= along >= np.cos(cone_deg(cell) * DEG) * np.linalg.norm(normal) * np.linalg.norm(beam, axis=1)
    return seen
