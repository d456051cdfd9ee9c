"""Pose targets: corrected in the branch asked for, and handed back as the poses to send to the controller."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.arm.inverse_kinematics import branch_index, inverse_kinematics, nearest_branch, within_limits
from calib.arm.kinematics import forward
from calib.arm.robot import Robot
from calib.array import Array
from calib.compensate.correct import checked, correct, inverse_poses
from calib.compensate.correction import Correction
from calib.model.model import RobotModel
from calib.model.stated import StatedConditions


@dataclass(frozen=True)
class PoseCorrection:
    """Corrected pose targets. nominal: (n, N) of the model, rad or mm, of the targets as they were, NaN out of
    reach; branch: (n,) index among the branches of the arm, -1 out of reach; poses: (n, 4, 4) the false targets
    of the tool point, mm, NaN where refused.
    """

    nominal: Array
    branch: NDArray[np.int64]
    correction: Correction
    poses: Array


def correct_poses(
    model: RobotModel,
    estimate: Array,
    poses: Array,
    stated: StatedConditions,
    *,
    branch: Sequence[str] | None = None,
    seed: Array | None = None,
    tool: Array | None = None,
    limits: Array | None = None,
    coupling: str = "none",
) -> PoseCorrection:
    """Correct poses (n, 4, 4) of the tool point in the base frame, mm.

    branch: one name for each pose; without it the branch nearest to `seed` (n, N), of the model, rad or mm. seed also
    chooses the turns, default those nearest to 0, where a track stands and where seven axes have their elbow.
    tool: (4, 4) nominal pose of the tool point on the flange, mm.
    The other arguments and the errors raised are those of `correct`; DataError as well for a robot that has no
    inverse kinematics here, ValueError when neither branch nor seed is given.
    """
    robot = model.robot
    tool = np.eye(4) if tool is None else np.asarray(tool, dtype=np.float64)
    poses = np.asarray(poses, dtype=np.float64)
    nominal, of_branch = postures_of(
        robot, poses @ inverse_poses(tool), branch=branch, seed=seed, limits=limits, coupling=coupling
    )
    correction = correct(model, estimate, nominal, stated, limits=limits, coupling=coupling)
    shifted = np.full_like(poses, np.nan)
    good = correction.good
    shifted[good] = forward(robot, correction.joints[good]) @ tool
    return PoseCorrection(nominal, of_branch, correction, shifted)


def postures_of(
    robot: Robot,
    flange: Array,
    *,
    branch: Sequence[str] | None = None,
    seed: Array | None = None,
    limits: Array | None = None,
    coupling: str = "none",
) -> tuple[Array, NDArray[np.int64]]:
    """Joints (n, N) of the model, rad or mm, and branch (n,) in flange poses (n, 4, 4); NaN and -1 for none.

    Arguments and errors raised: see `correct_poses`.
    """
    if branch is None and seed is None:
        raise ValueError("give the branch of every pose or a seed")
    solutions = inverse_kinematics(robot, flange, seed=seed)
    n = len(flange)
    near, limits = checked(robot, np.zeros((n, robot.joints)) if seed is None else seed, limits)
    # Whole turns are counted where the limits are: in the controller's angles.
    counted = robot.controller_angles(solutions.joints, coupling)
    seeded = robot.controller_angles(near, coupling)
    turned = within_limits(counted, seeded[:, None, :], limits[:, 0], limits[:, 1], slides=robot.slides)
    if branch is None:
        chosen = nearest_branch(turned, seeded)
    else:
        if len(branch) != n:
            raise ValueError(f"{len(branch)} branches for {n} poses")
        chosen = np.array([branch_index(name, among=solutions.branches) for name in branch], dtype=np.int64)
    rows = np.arange(n)
    joints = np.full((n, robot.joints), np.nan)
    found = np.isfinite(turned[rows, chosen, 0])
    joints[found] = robot.model_angles(turned[rows, chosen][found], coupling)
    return joints, np.where(found, chosen, -1)
