"""The inverse direction: joints of the nominal robot in the poses that the real robot takes, actual to nominal.

For targets that were taught on the real robot and shall be shown, or programmed on, in a world where robots are
nominal: q_nom = IK_nom(FK_cal(q)). What `calib.compensate.correct` makes of q_nom is q again.
"""

from __future__ import annotations

import numpy as np

from calib.array import Array
from calib.compensate.calibrated import Calibrated
from calib.compensate.correct import checked, refused
from calib.compensate.correction import Correction
from calib.compensate.inverse import nominal_inverse, pose_difference
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
    known = np.all(np.isfinite(joints), axis=1)
    reached = Calibrated(model, estimate, stated, target, regression).poses(joints[known])
    found = np.full_like(joints, np.nan)
    found[known] = nominal_inverse(robot, reached, joints[known], tool)
    miss = pose_difference(reached, nominal_poses(model, found[known], tool))
    landed, turned = np.full(len(joints), np.inf), np.full(len(joints), np.inf)
    landed[known], turned[known] = (np.linalg.norm(part, axis=1) for part in (miss[:, :3], miss[:, 3:]))
    refusals = refused(robot, joints, found, landed, turned, limits, coupling, tool, regression, joints[None])
    return Correction.of(found, refusals, landed, turned, known.astype(np.int64))
