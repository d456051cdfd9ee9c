"""Joint angles of the controller for a flange pose of the nominal robot, branch by branch."""

from __future__ import annotations

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.cell.workspace import Array
from calib.arm import BRANCHES, inverse_kinematics, within_limits


def configurations(cell: Cell, flange: Array, seed_deg: Array | None = None) -> Array:
    """Compute the joint angles (n, 8, N), deg, for flange poses (n, 4, 4), mm.

    The branches are in the order of `calib.arm.inverse_kinematics.BRANCHES`; an arm with fewer branches has its own
    first. Of the turns within the cell's limits, those nearest to `seed_deg` (N,), default 0, are taken. A branch that
    does not reach or that the limits forbid is NaN.

    Raises
    ------
    DataError
        The robot has no inverse kinematics here.
    """
    robot, coupling = cell.robot.model, cell.robot.coupling
    low, high = cell.robot.limits.T
    near = np.zeros(robot.joints) if seed_deg is None else np.asarray(seed_deg) * robot.joint_units
    # Whole turns are counted where the limits are: in the controller's angles.
    seed = np.broadcast_to(robot.model_angles(near[None], coupling), (len(flange), robot.joints))
    found = inverse_kinematics(robot, flange, seed=seed).joints[:, : len(BRANCHES)]
    joints = np.full((len(flange), len(BRANCHES), robot.joints), np.nan)
    joints[:, : found.shape[1]] = found
    counted = robot.controller_angles(joints, coupling)
    return within_limits(counted, near, low, high, slides=robot.slides) / robot.joint_units
