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
from numpy.typing import NDArray

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.data.conditions import Conditions
from calib.errors import DataError
from calib.fit.uncertainty import predict_with_covariance
from calib.model.model import Design, RobotModel
from calib.model.reduced import without
from calib.model.stated import FLANGE, StatedConditions, conditions_at, series_of
from calib.regression.regression import Regression, world_points

CORRECTED_OWNERS = ("robot", "mounting")
_BEYOND = 1e-6  # of the width of the measured range: rounding of a target at its border


def corrects(model: RobotModel, series: str) -> Array:
    """(m,) 1 for parameters of the robot and its mounting, 0 for those of the instrument, and of a base that the fit
    placed."""
    owned = model.owned(CORRECTED_OWNERS)
    if series in model.placements:
        owned[model.of_base] = 0.0
    return owned


def in_base(model: RobotModel) -> RobotModel:
    """The model in the frame of its base, with the flange as another target."""
    targets = {name: {FLANGE: (0.0, 0.0, 0.0), **known} for name, known in model.targets.items()}
    # `turns` say how a measuring tool is mounted, not where the flange is.
    return replace(model, targets=targets, placements={}, turns={})


class Calibrated:
    """The calibrated robot at stated conditions, with the base as the nominal frame where the fit placed it.

    estimate: (m,) of the model, zero where a parameter is the instrument's or only says where the base was put, and
    for carried terms that follow what is known only during a campaign (`calib.compensate.for_use` adapts the others).
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
        known = np.array([e.is_usable for e in model.effects for _ in e.parameters])
        self._acts = corrects(model, series) * known
        self.estimate = np.where(self._acts > 0.0, estimate, 0.0)
        self._model = in_base(model)
        self._plain = model
        self._stated = stated
        self._target = target
        self._regression = regression

    def design(self, joints: Array) -> Design:
        """The model in n poses. Raises DataError when it needs a condition that was not stated."""
        design = Design(self._model, self._at(joints))
        for position, _, drive in design.terms:
            if self.estimate[position] != 0.0 and not np.all(np.isfinite(drive)):
                name = self._model.parameters[position].name
                raise DataError(
                    f"the model holds {name}, which depends on a condition that was not stated.",
                    do="State the temperature and the time for which the correction shall hold.",
                    key="conditions",
                )
        return design

    def _at(self, joints: Array) -> Conditions:
        return conditions_at(self._plain, joints, self._stated, self._target)

    def poses(self, joints: Array) -> Array:
        """(n, 4, 4) at model angles (n, N), rad. Raises DataError like `design`."""
        design = self.design(joints)
        poses = poses_of(design.frames(self.estimate, record=()), len(joints))
        if self._regression is not None:
            _, base = world_points(self._model, self.estimate, design.conditions)
            shift = self._regression.shift(self._model.robot, joints)
            poses[:, :3, 3] += np.einsum("nij,nj->ni", base, shift)
        return poses

    def beyond(self, *joints: Array) -> tuple[tuple[str, ...], ...]:
        """Per target, at model angles asked and driven (n, N), rad: quantities outside the range in which the carried
        terms that act were measured."""
        model = self._model.without(*(e.label for e in self._model.effects if not e.is_usable))
        found: dict[str, NDArray[np.bool_]] = {}
        for there in joints:
            for name, distance in model.beyond(self._at(there)).items():
                found[name] = found.get(name, np.False_) | (distance > _BEYOND)
        return tuple(tuple(name for name, rows in found.items() if rows[i]) for i in range(len(joints[0])))

    def covariance_of_points(self, joints: Array, covariance: Array) -> Array:
        """(n, 3, 3) covariances, mm2, of the target at model angles (n, N), rad, from that of the model, (m, m)."""
        acting = covariance * np.outer(self._acts, self._acts)
        conditions = self._at(joints)
        held = [e for e in self._model.effects if not e.is_usable]
        model, estimate, acting = without(self._model, self.estimate, acting, held)
        return predict_with_covariance(model, estimate, acting, conditions)[1]


def poses_of(frames: Frames, n: int) -> Array:
    """(n, 4, 4) of the target frame."""
    poses = np.zeros((n, 4, 4))
    poses[:, :3, :3] = frames.rotation
    poses[:, :3, 3] = np.broadcast_to(frames.p, (3, n)).T
    poses[:, 3, 3] = 1.0
    return poses
