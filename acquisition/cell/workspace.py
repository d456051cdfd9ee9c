"""The workspace of a cell: allowed places of arm and tool, and visibility of targets.

Arm and tool are capsules (`cell.arm`) that keep clear of table, boxes and fixtures (`cell.clearance`). A target whose
normal the cell declares is visible within the cone that the instrument accepts. Lengths mm, angles deg.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from acquisition.cell.cell import Cell
from calib.arm import forward
from calib.units import DEG

Array = NDArray[np.float64]
_UPPER_ARM = 2  # the link before the elbow


def targets_at(cell: Cell, joints_deg: Array) -> Array:
    """Compute the positions of the m targets in the world for the nominal robot.

    The joint angles (n, N) are those of the controller; the result is (n, m, 3) in mm.
    """
    poses = forward(cell.robot.model, cell.robot.model_angles(joints_deg))
    targets = np.array(list(cell.tool.targets.values()))
    return np.einsum("nij,mj->nmi", poses[:, :3, :3], targets) + poses[:, None, :3, 3]


def lowest_of(cell: Cell, joints_deg: Array) -> Array:
    """Compute the height (n,), mm, of the lowest point of arm and tool at joint angles (n, N).

    Only the links from the elbow on count.
    """
    arm = cell.clearance.arm
    bottom = arm.lines(joints_deg)[:, :, :, 2].min(axis=2) - arm.radii
    return bottom[:, arm.links > _UPPER_ARM].min(axis=1)


def within_limits(cell: Cell, joints_deg: Array) -> NDArray[np.bool_]:
    """Check that joint angles (n, N) are within the limits of the cell."""
    low, high = np.array(cell.robot.limits_deg).T
    return np.all((joints_deg >= low) & (joints_deg <= high), axis=1)


def is_allowed(cell: Cell, joints_deg: Array) -> NDArray[np.bool_]:
    """Check that joint angles (n, N) are within the limits, and arm and tool clear."""
    good = within_limits(cell, joints_deg)
    good[good] = cell.clearance.clear_at(joints_deg[good])
    return good


def facing(cell: Cell, joints_deg: Array, targets: Sequence[str]) -> NDArray[np.bool_]:
    """Check that `targets` with a normal face the instrument, within its cone, mask (n,)."""
    return np.all(beyond_cone(cell, joints_deg, targets) >= 0.0, axis=1)


def beyond_cone(cell: Cell, joints_deg: Array, targets: Sequence[str]) -> Array:
    """Compute how much better than at the edge of its cone the instrument sees each of m targets, (n, m).

    It is the difference of the cosines of the angles between normal and beam: negative outside the cone, 0 for a target
    without a normal, which is visible from everywhere.
    """
    poses = forward(cell.robot.model, cell.robot.model_angles(joints_deg))
    least = np.cos(cell.instrument.declared.cone_deg * DEG)
    out = np.zeros((len(poses), len(targets)))
    for k, name in enumerate(targets):
        if name not in cell.tool.normals:
            continue
        normal = np.array(cell.tool.normals[name])
        place = poses[:, :3, :3] @ np.array(cell.tool.targets[name]) + poses[:, :3, 3]
        beam = np.array(cell.instrument.station_mm) - place
        along = np.sum((poses[:, :3, :3] @ normal) * beam, axis=1)
        out[:, k] = along / (np.linalg.norm(normal) * np.linalg.norm(beam, axis=1)) - least
    return out
