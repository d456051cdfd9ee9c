"""The inverse direction: joints of the nominal robot in the poses that the real robot takes, actual to nominal.

For targets that were taught on the real robot and shall be shown, or programmed on, in a world where robots are
nominal: q_nom = IK_nom(FK_cal(q)). What `calib.compensate.correct` makes of q_nom is q again.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arm.freedoms import Freedoms
from calib.arm.inverse_kinematics.near import nominal_inverse
from calib.array import Array
from calib.compensate.calibrated import Calibrated
from calib.compensate.correct import checked, refused
from calib.compensate.correction import Correction
from calib.compensate.misses import Misses
from calib.model.model import RobotModel
from calib.model.stated import FLANGE, StatedConditions, nominal_poses, series_of, tool_point
from calib.regression.regression import Regression


def nominal_of(
    model: RobotModel,
    estimate: Array,
    joints: Array,
    stated: StatedConditions,
    *,
    target: str = FLANGE,
    limits: Array | None = None,
    coupling: str = "none",
    regression: Regression | None = None,
) -> Correction:
    """Joints (n, N) at which the nominal robot is in the pose that the real one takes at `joints` (n, N), rad.

    Arguments, refusals and errors raised are those of `correct`.
    """
    robot = model.robot
    joints, limits = checked(robot, joints, limits)
    tool = tool_point(model, series_of(model, stated), target)
    arm = Freedoms.of(robot, limits, coupling, tool)
    known = np.flatnonzero(np.all(np.isfinite(joints), axis=1))
    calibrated = Calibrated(model, estimate, stated, target, regression)
    reached = calibrated.poses(joints[known])
    found, misses = np.full_like(joints, np.nan), Misses.unknown(len(joints))
    found[known] = nominal_inverse(robot, reached, joints[known], tool, arm)
    misses.take(known, arm, robot, found[known], tool, nominal_poses(model, found[known], tool), reached)
    refusals = refused(robot, arm, joints, found, misses, limits, coupling, tool, regression, joints[None])
    done = misses.correction(found, refusals, np.isfinite(misses.landed).astype(np.int64), arm)
    return replace(done, beyond=calibrated.beyond(joints))
