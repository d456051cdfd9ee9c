"""The inverse direction: joints of the nominal robot in the poses that the real robot takes, actual to nominal.

For targets that were taught on the real robot and shall be shown, or programmed on, in a world where robots are
nominal: q_nom = IK_nom(FK_cal(q)). What `calib.compensate.correct` makes of q_nom is q again.
"""

from __future__ import annotations

import numpy as np

from calib.compensate.calibrated import Calibrated
from calib.compensate.correct import checked, refused
from calib.compensate.correction import Correction
from calib.compensate.inverse import nominal_inverse, pose_difference
from calib.compensate.stated import FLANGE, StatedConditions, nominal_poses, series_of, tool_point
from calib.kinematics import Array
from calib.model import RobotModel


def nominal_of(
    model: RobotModel,
    estimate: Array,
    joints: Array,
    stated: StatedConditions,
    *,
    target: str = FLANGE,
    limits: Array | None = None,
    coupling: str = "none",
) -> Correction:
    """Joints (n, N) at which the nominal robot stands where the real one stands at `joints` (n, N), rad.

    Arguments, refusals and errors raised are those of `correct`.
    """
    robot = model.robot
    joints, limits = checked(robot, joints, limits)
    tool = tool_point(model, series_of(model, stated), target)
    known = np.all(np.isfinite(joints), axis=1)
    stands = Calibrated(model, estimate, stated, target).poses(joints[known])
    found = np.full_like(joints, np.nan)
    found[known] = nominal_inverse(robot, stands, joints[known], tool)
    miss = pose_difference(stands, nominal_poses(model, found[known], tool))
    landed, turned = np.full(len(joints), np.inf), np.full(len(joints), np.inf)
    landed[known], turned[known] = (np.linalg.norm(part, axis=1) for part in (miss[:, :3], miss[:, 3:]))
    refusals = refused(robot, joints, found, landed, turned, limits, coupling, tool)
    return Correction.of(found, refusals, landed, turned, known.astype(np.int64))
