"""Inverse kinematics of a robot: its structure is found, and all branches of poses are solved."""

from __future__ import annotations

import numpy as np

from calib.arm.inverse_kinematics.arm import Arm
from calib.arm.inverse_kinematics.five_axes import FiveAxes
from calib.arm.inverse_kinematics.offset_wrist import OffsetWrist
from calib.arm.inverse_kinematics.scara import Scara
from calib.arm.inverse_kinematics.seven_axes import SevenAxes
from calib.arm.inverse_kinematics.six_axes import SixAxes
from calib.arm.inverse_kinematics.solutions import Solutions
from calib.arm.inverse_kinematics.standing import Standing
from calib.arm.inverse_kinematics.zero_pose import ZeroPose
from calib.arm.robot import Robot
from calib.array import Array
from calib.errors import DataError

_KINDS = {4: Scara, 5: FiveAxes, 6: SixAxes, 7: SevenAxes}


def inverse_kinematics(robot: Robot, poses: Array, *, seed: Array | None = None) -> Solutions:
    """All branches of the flange poses (n, 4, 4), base frame, mm.

    seed: (n, N) model joints, rad or mm: a singular pose takes from it the joint that it leaves free, seven axes the
    place of the elbow, an arm on a track the position of the track; default 0.
    Raises DataError for a robot that has no inverse kinematics here, ValueError for arrays of the wrong shape or with
    numbers that are not finite.
    """
    poses = np.asarray(poses, dtype=np.float64)
    if poses.ndim != 3 or poses.shape[1:] != (4, 4):
        raise ValueError(f"poses have shape {poses.shape}; needed (n, 4, 4)")
    if not np.all(np.isfinite(poses)):
        raise ValueError("poses hold numbers that are not finite")
    shape = len(poses), robot.joints
    seed = np.zeros(shape) if seed is None else np.asarray(seed, dtype=np.float64)
    if seed.shape != shape:
        raise ValueError(f"seed has shape {seed.shape}; needed {shape}")
    return arm_of(robot).solve(poses, seed)


def arm_of(robot: Robot) -> Arm:
    """The arm of a nominal robot. Raises DataError, saying what prevents it, for one that has no known structure."""
    return _arm_of(ZeroPose.of(robot))


def _arm_of(zero: ZeroPose) -> Arm:
    kind = _KINDS.get(zero.joints)
    try:
        if kind is None:
            raise zero.refused(f"it has {zero.joints} joints")
        return kind.of(zero)
    except DataError as why:
        if zero.joints == 6 and all(zero.turns):
            found = OffsetWrist.of(zero)
            if found is not None:
                return found
        elif zero.joints > 4:
            try:
                return Standing(zero, _arm_of(zero.without_first()))
            except DataError:
                pass
        raise why
