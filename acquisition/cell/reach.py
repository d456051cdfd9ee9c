"""Joint angles of the controller that put the nominal robot's flange where it is wanted, branch by branch."""

from __future__ import annotations

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.cell.workspace import Array
from calib.arm import inverse_kinematics, within_limits
from calib.units import DEG


def configurations(cell: Cell, flange: Array, seed_deg: Array | None = None) -> Array:
    """(n, 8, 6) deg for flange poses (n, 4, 4), mm, in the order of `calib.arm.inverse_kinematics.BRANCHES`.

    The turns within the cell's limits that are nearest to `seed_deg` (6,), default 0; NaN where a branch does not
    reach or the limits forbid it. Raises DataError for a robot without inverse kinematics in closed form.
    """
    robot, coupling = cell.robot.model, cell.robot.coupling
    low, high = np.array(cell.robot.limits_deg).T * DEG
    near = np.zeros(robot.joints) if seed_deg is None else np.asarray(seed_deg) * DEG
    # Whole turns are counted where the limits are: in the controller's angles.
    counted = robot.controller_angles(inverse_kinematics(robot, flange).joints, coupling)
    return within_limits(counted, near, low, high) / DEG
