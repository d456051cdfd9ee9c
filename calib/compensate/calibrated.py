"""The calibrated robot at stated conditions: FK_cal of the pose shift.

It holds what belongs to the robot and to its mounting, never what belongs to the instrument. Where the world is the
nominal base frame, the identified base is part of the error; where the base was placed by the fit (a model with
placements), the world is arbitrary, and the identified base frame takes its place: its parameters are left out.
A regression based on the model shifts every target by the error that it predicts for its own point; it corrects no
orientation.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.errors import DataError
from calib.model.model import Design, RobotModel
from calib.model.stated import FLANGE, StatedConditions, conditions_at, series_of
from calib.regression.regression import Regression, world_points

CORRECTED_OWNERS = ("robot", "mounting")


class Calibrated:
    """The calibrated robot at stated conditions, with the base as the nominal frame where the fit placed it.

    estimate: (m,) of the model, zero where a parameter is the instrument's or only says where the base was put.
    """

    def __init__(
        self,
        model: RobotModel,
        estimate: Array,
        stated: StatedConditions,
        target: str = FLANGE,
        regression: Regression | None = None,
    ) -> None:
        series = series_of(model, stated)
        owned = model.owned(CORRECTED_OWNERS)
        if series in model.placements:
            owned[model.of_base] = 0.0
        self.estimate = np.where(owned > 0.0, estimate, 0.0)
        targets = {name: {FLANGE: (0.0, 0.0, 0.0), **known} for name, known in model.targets.items()}
        # `turns` say how a measuring tool is mounted, not where the flange is.
        self._model = replace(model, targets=targets, placements={}, turns={})
        self._plain = model
        self._stated = stated
        self._target = target
        self._regression = regression

    def design(self, joints: Array) -> Design:
        """The model in n poses. Raises DataError when it needs a condition that was not stated."""
        design = Design(self._model, conditions_at(self._plain, joints, self._stated, self._target))
        for position, _, drive in design.terms:
            if self.estimate[position] != 0.0 and not np.all(np.isfinite(drive)):
                name = self._model.parameters[position].name
                raise DataError(
                    f"the model holds {name}, which depends on a condition that was not stated.",
                    do="State the temperature and the time for which the correction shall hold.",
                    key="conditions",
                )
        return design

    def poses(self, joints: Array) -> Array:
        """(n, 4, 4) at model angles (n, N), rad. Raises DataError like `design`."""
        design = self.design(joints)
        poses = poses_of(design.frames(self.estimate, record=()), len(joints))
        if self._regression is not None:
            _, base = world_points(self._model, self.estimate, design.conditions)
            shift = self._regression.shift(self._model.robot, joints)
            poses[:, :3, 3] += np.einsum("nij,nj->ni", base, shift)
        return poses


def poses_of(frames: Frames, n: int) -> Array:
    """(n, 4, 4) of the target frame."""
    poses = np.zeros((n, 4, 4))
    poses[:, :3, :3] = frames.rotation
    poses[:, :3, 3] = np.broadcast_to(frames.p, (3, n)).T
    poses[:, 3, 3] = 1.0
    return poses
