"""The calibrated robot at stated conditions, and the part of a model usable for corrections.

The calibrated robot is FK_cal of the pose shift. It includes the effects of the robot and of its
mounting, never those of the instrument. If the world is the nominal base frame, the identified base is
part of the error. If the fit placed the base (a model with placements), the world is arbitrary. The
identified base frame then takes its place, and its parameters are left out. A regression based on the
model shifts every target by the error that it predicts for its own point; it corrects no orientation.

Carried terms whose conditions only a campaign has cannot be used for corrections. A function of time is
known while the readings are taken, and not afterwards; the last move is not known for a target. Such
terms are left out, and the other parameters adapted to first order (`calib.model.model`). The loss is
the distance between both models over random poses within the joint limits, at random times of the
campaign:

    loss = |p_whole(q, t) - p_usable(q, t)|
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.data.conditions import Conditions
from calib.errors import DataError
from calib.fit.identification import predict_with_covariance
from calib.fit.statistics import ErrorStatistics, distances, statistics_of
from calib.model.carried_regressors import OfTime
from calib.model.effect import Effect
from calib.model.model import (
    FLANGE,
    BoundModel,
    ModelStructure,
    StatedConditions,
    conditions_at,
    series_of,
    without,
)
from calib.regression.regression import Regression, world_points

CORRECTED_OWNERS = ("robot", "mounting")
_BEYOND = 1e-6  # of the width of the measured range: rounding of a target at its border
_SAMPLES = 500
_NAMED = 6  # terms named in one line; the document names all
_SECONDS, _AIR_C = 3600.0, 20.0  # for named effects of time and temperature where none is stated


def corrects(model: ModelStructure, series: str) -> Array:
    """Return 1 for the parameters that a correction includes, otherwise 0, shape (m,).

    These are the parameters of the robot and its mounting, without a base that the fit placed.
    """
    owned = model.owned(CORRECTED_OWNERS)
    if series in model.placements:
        owned[model.of_base] = 0.0
    return owned


def in_base(model: ModelStructure) -> ModelStructure:
    """Convert a model to the frame of its base, with the flange as another target."""
    targets = {name: {FLANGE: (0.0, 0.0, 0.0), **known} for name, known in model.targets.items()}
    # `turns` say how a measuring tool is mounted, not where the flange is.
    return replace(model, targets=targets, placements={}, turns={})


class Calibrated:
    """The calibrated robot at stated conditions.

    If the fit placed the base, that base is the nominal frame.

    Attributes
    ----------
    estimate : array of shape (m,)
        Estimate of the model. It is zero for parameters of the instrument and for those of a base that
        the fit placed. It is also zero for carried terms of quantities that are known only during a
        campaign (this module adapts the others).
    """

    def __init__(
        self,
        model: ModelStructure,
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

    def design(self, joints: Array) -> BoundModel:
        """Bind the model to n poses.

        Raises
        ------
        DataError
            The model needs a condition that was not stated.
        """
        design = BoundModel(self._model, self._at(joints))
        for position, _, drive in design.terms:
            if self.estimate[position] != 0.0 and not np.all(np.isfinite(drive)):
                name = self._model.parameters[position].name
                raise DataError(
                    f"the model holds {name}, which depends on a condition that was not stated.",
                    do="State the temperature and the time for which the correction is needed.",
                    key="conditions",
                )
        return design

    def _at(self, joints: Array) -> Conditions:
        return conditions_at(self._plain, joints, self._stated, self._target)

    def poses(self, joints: Array) -> Array:
        """Compute the poses at model angles (n, N), rad, shape (n, 4, 4).

        Raises
        ------
        DataError
            As `design`.
        """
        design = self.design(joints)
        poses = poses_of(design.frames(self.estimate, record=()), len(joints))
        if self._regression is not None:
            _, base = world_points(self._model, self.estimate, design.conditions)
            shift = self._regression.shift(self._model.robot, joints)
            poses[:, :3, 3] += np.einsum("nij,nj->ni", base, shift)
        return poses

    def beyond(self, *joints: Array) -> tuple[tuple[str, ...], ...]:
        """List, for each target, the quantities outside their measured range.

        It is the range in which the acting carried terms were measured. `joints` are the requested and
        the driven model angles (n, N), rad.
        """
        model = self._model.without(*(e.label for e in self._model.effects if not e.is_usable))
        found: dict[str, NDArray[np.bool_]] = {}
        for there in joints:
            for name, distance in model.beyond(self._at(there)).items():
                found[name] = found.get(name, np.False_) | (distance > _BEYOND)
        return tuple(tuple(name for name, rows in found.items() if rows[i]) for i in range(len(joints[0])))

    def covariance_of_points(self, joints: Array, covariance: Array) -> Array:
        """Compute the covariances of the target from that of the model, (n, 3, 3), mm2.

        `joints` (n, N) are model angles, rad; `covariance` is (m, m).
        """
        acting = covariance * np.outer(self._acts, self._acts)
        conditions = self._at(joints)
        held = [e for e in self._model.effects if not e.is_usable]
        model, estimate, acting = without(self._model, self.estimate, acting, held)
        return predict_with_covariance(model, estimate, acting, conditions)[1]


def poses_of(frames: Frames, n: int) -> Array:
    """Return the poses of the target frame, shape (n, 4, 4)."""
    poses = np.zeros((n, 4, 4))
    poses[:, :3, :3] = frames.rotation
    poses[:, :3, 3] = np.broadcast_to(frames.p, (3, n)).T
    poses[:, 3, 3] = 1.0
    return poses


@dataclass(frozen=True)
class Usable:
    """A model for corrections.

    Attributes
    ----------
    estimate, covariance : array of shape (m,), (m, m)
        Internal units.
    left_out : tuple of Effect
        Carried terms that it lacks.
    loss : ErrorStatistics or None
        Error from leaving them out, mm; None if nothing was left out.
    """

    model: ModelStructure
    estimate: Array
    covariance: Array
    left_out: tuple[Effect, ...]
    loss: ErrorStatistics | None

    @property
    def in_words(self) -> tuple[str, ...]:
        """Sentences on the terms left out, and the loss; empty if nothing was left out."""
        if self.loss is None:
            return ()
        names = ", ".join(effect.label for effect in self.left_out[:_NAMED])
        more = len(self.left_out) - _NAMED
        return (
            f"Carried terms that the correction leaves out: {names}{f' and {more} more' if more > 0 else ''}. Without "
            f"them positions change by {self.loss.rms:.3f} mm RMS, {self.loss.max:.3f} mm at most, at {self.loss.n} "
            "random poses and times of the campaign.",
        )


def usable(
    model: ModelStructure,
    estimate: Array,
    covariance: Array,
    stated: StatedConditions,
    *,
    named_only: bool = False,
    coupling: str = "none",
) -> Usable:
    """Remove the carried terms that cannot be used for corrections from a model.

    Parameters
    ----------
    model : ModelStructure
        The whole model.
    estimate, covariance : array of shape (m,), (m, m)
        Internal units.
    stated : StatedConditions
        Loads, gravity and air for the loss.
    named_only : bool, optional
        Remove all carried terms.
    coupling : str, optional
        Joint matrix of the controller.
    """
    left_out = tuple(e for e in model.effects if e.is_carried and (named_only or not e.is_usable))
    less, values, spread = without(model, estimate, covariance, left_out)
    if not left_out:
        return Usable(less, values, spread, (), None)
    robot, rng, series = model.robot, np.random.default_rng(1), stated.series or next(iter(model.targets))
    joints, before = (
        robot.model_angles(rng.uniform(robot.lower, robot.upper, (_SAMPLES, robot.joints)), coupling)
        for _ in range(2)
    )
    clocks = {"time": (_SECONDS, _SECONDS)} | {
        term.regressor.clock: (term.regressor.times[0], term.regressor.times[-1])
        for effect in left_out
        for term in effect.terms
        if isinstance(term.regressor, OfTime)
    }
    air = _AIR_C if np.isnan(stated.temperature_c) else stated.temperature_c
    conditions = replace(
        conditions_at(model, joints, replace(stated, series=series, temperature_c=air)),
        previous=before,
        **{clock: rng.uniform(*ends, _SAMPLES) for clock, ends in clocks.items()},
    )
    whole, part = (
        BoundModel(in_base(each), conditions).predict(x * corrects(each, series))
        for each, x in ((model, estimate), (less, values))
    )
    return Usable(less, values, spread, left_out, statistics_of(distances(whole, part)))
