"""What a calibrated model sees in readings that were taken later: residuals, and why they may differ from nothing.

    r = measured - predicted = A x + J e + T w + F f + noise

x: what has changed. Nothing of the rest is a change: e ~ P is what the calibration left uncertain; w what the model was
shown to lack by its own validation, as if the joints scattered more (the same in every watch at the same poses); f the
frame, set up anew each time; and noise with the robot's repeatability. All rows are whitened by the noise as in a fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.data.dataset import Dataset
from calib.effects import Survey, changes, compliance_of
from calib.fit.least_squares import jacobian
from calib.fit.readings import Readings, readings_of
from calib.fit.uncertainty import predict_with_covariance
from calib.model.effect import Effect
from calib.model.model import Design, RobotModel
from calib.model.regressors import Time, WarmUp
from calib.model.stated import AFTER_EVERYTHING
from calib.saved import SavedModel
from calib.watch.frame import frame_covariance, frame_effect


@dataclass(frozen=True)
class Seen:
    """Readings of q measured rows as a baseline sees them, whitened by noise and repeatability.

    estimate (m,), covariance (m, m): the baseline's, internal units; residual (q,); lasting (q, a), passing (q, b):
    columns of unit variance of what stays the same from watch to watch, and of what is drawn anew; causes, and the
    columns (q, p) of each.
    """

    model: RobotModel
    estimate: Array
    covariance: Array
    readings: Readings
    residual: Array
    of_parameters: Array  # (q, m)
    lasting: Array
    passing: Array
    causes: tuple[Effect, ...]
    columns: tuple[Array, ...]

    @classmethod
    def of(
        cls, saved: SavedModel, dataset: Dataset, *, frame_known: bool = True, lack: float | None = None
    ) -> Seen:
        """The usable readings of a data set. frame_known False: where robot and instrument stand is not compared.

        lack: what the model lacks, as scatter of the joints, rad; None: as `scatter_beyond` finds it.

        Raises DataError as the readers do; what makes them no watch of this robot is `refusals.refuse_unlike`'s.
        """
        model, dataset = _in_series(saved.model, dataset)
        estimate, covariance = _without_drifts(model, saved)
        readings = readings_of(dataset, dataset.fit_rows, model, estimate)
        design = Design(model, readings.conditions)
        causes = _causes(model, estimate, saved, dataset, readings)
        frame = frame_effect()
        others = RobotModel(model.robot, (*_apart(causes), frame), model.targets, anchors=model.anchors)
        beside = Design(others, readings.conditions)
        joints = model.robot.joint_slots
        frames = design.frames(estimate, {*design.slots, *beside.slots, *joints})
        measured = _measured(readings)
        of_parameters = jacobian(design, readings.observed, frames)[measured]
        of_others = jacobian(beside, readings.observed, frames)[measured]
        ends = np.cumsum([0, *(len(cause.parameters) for cause in causes)])
        of_causes = tuple(of_others[:, a:b] for a, b in pairwise(ends))
        header = dataset.header
        of_frame = of_others[:, ends[-1] :] @ _root(
            frame_covariance(header.nests, header.noise, model.station)
        )
        lack = scatter_beyond(saved, dataset) if lack is None else lack
        lasting = np.column_stack([of_parameters @ _root(covariance), of_frame])
        if lack > 0.0:
            lasting = np.column_stack([lasting, lack * _by_joint(readings, frames, joints)[measured]])
        passing = of_frame
        if not frame_known:
            where = next(c for e, c in zip(causes, of_causes, strict=True) if e.label == "base_shift")
            passing = np.column_stack([passing, _FREE * where / _length(where)])
        residual = readings.observed.residual(frames).reshape(-1)[measured]
        return cls(
            model,
            estimate,
            covariance,
            readings,
            residual,
            of_parameters,
            lasting,
            passing,
            causes,
            of_causes,
        )

    def spread(self, share: float = 1.0) -> Array:
        """(q, q) covariance of the residual with nothing changed; share: of the variance of noise and frame, below one
        for a mean over watches."""
        of_noise = np.eye(len(self.residual)) + self.passing @ self.passing.T
        return share * of_noise + self.lasting @ self.lasting.T

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """(k n,) rows that were measured."""
        return _measured(self.readings)

    def exact(self, cause: Effect, values: Array) -> Array:
        """(q,) residual where a cause has some values (p,), through the whole chain."""
        model = replace(self.model, effects=(*self.model.effects, *_apart((cause,))))
        frames = Design(model, self.readings.conditions).frames(np.concatenate([self.estimate, values]), ())
        return self.readings.observed.residual(frames).reshape(-1)[self.measured]

    def displacement(self, cause: Effect) -> Array:
        """(3 n, p) derivative of the predicted points by the parameters of a cause, mm."""
        baseline = Design(self.model, self.readings.conditions)
        design = Design(
            RobotModel(self.model.robot, (cause,), self.model.targets, anchors=self.model.anchors),
            self.readings.conditions,
        )
        return design.point_columns(baseline.frames(self.estimate, {*design.slots}))


_FREE = 1e4  # standard deviations of the noise by which an unknown frame may be elsewhere


def scatter_beyond(saved: SavedModel, dataset: Dataset) -> float:
    """By how much, rad, the joints would have to scatter more than declared for the errors that the calibration found
    on readings it had not seen; without such readings, for those of its fit. Nothing where these are as declared."""
    model, dataset = _in_series(saved.model, dataset)
    estimate, covariance = _without_drifts(model, saved)
    rows = dataset.fit_rows & dataset.pointed
    if not rows.any():
        return 0.0
    conditions, noise = dataset.conditions.take(rows), dataset.header.noise
    joints = model.robot.joint_slots
    design = Design(model, conditions)
    frames = design.frames(estimate, joints)
    of_joints = float(np.mean(np.sum(frames.velocities(joints) ** 2, axis=(0, 1))))
    instrument = noise.of_points(dataset.points[rows], dataset.u_point[rows])
    known = float(np.mean(np.trace(instrument, axis1=1, axis2=2))) + noise.repeatability**2 * of_joints
    if saved.held_out_rms_mm is None:
        beyond = (max(saved.noise_scale, 1.0) ** 2 - 1.0) * known
    else:
        uncertain = predict_with_covariance(model, estimate, covariance, conditions)[1]
        beyond = saved.held_out_rms_mm**2 - known - float(np.mean(np.trace(uncertain, axis1=1, axis2=2)))
    return float(np.sqrt(max(beyond, 0.0) / of_joints))


def _in_series(model: RobotModel, dataset: Dataset) -> tuple[RobotModel, Dataset]:
    """The model of the one series of a data set, whatever both call it, and the readings after all that the model says
    happened during the calibration."""
    conditions = dataset.conditions
    conditions = replace(
        conditions,
        series_names=(next(iter(model.targets)),),
        order=np.full(len(conditions), AFTER_EVERYTHING),
    )
    return model, replace(dataset, conditions=conditions)


def _without_drifts(model: RobotModel, saved: SavedModel) -> tuple[Array, Array]:
    """The estimate without what the instrument did with time in its own campaign."""
    gone = {
        term.parameter
        for effect in model.effects
        if effect.owner == "instrument"
        for term in effect.terms
        if isinstance(term.regressor, Time | WarmUp)
    }
    kept = np.array([p.name not in gone for p in model.parameters], dtype=float)
    return saved.estimate * kept, saved.covariance * np.outer(kept, kept)


def _causes(
    model: RobotModel, estimate: Array, saved: SavedModel, dataset: Dataset, readings: Readings
) -> tuple[Effect, ...]:
    """What may have set in. Where the model has an effect already, its bounds hold for both together."""
    survey = Survey(
        robot=model.robot,
        conditions=readings.conditions,
        compliance=compliance_of(model, estimate),
        loads=saved.loads,
        station=_station(dataset),
    )
    return tuple(_beyond(cause, model, estimate) for cause in changes(survey))


def _beyond(cause: Effect, model: RobotModel, estimate: Array) -> Effect:
    parameters = []
    for p in cause.parameters:
        had = (
            float(estimate[model.index[p.name]] / model.unit[model.index[p.name]])
            if p.name in model.index
            else 0.0
        )
        low, high = (None if bound is None else bound - had for bound in (p.low, p.high))
        parameters.append(replace(p, low=low, high=high))
    return replace(cause, parameters=tuple(parameters))


def _apart(causes: Sequence[Effect]) -> tuple[Effect, ...]:
    """The causes with parameters of names that no effect of the model has."""
    return tuple(
        replace(
            cause,
            parameters=tuple(replace(p, name=f"since.{p.name}") for p in cause.parameters),
            terms=tuple(replace(t, parameter=f"since.{t.parameter}") for t in cause.terms),
        )
        for cause in causes
    )


def _station(dataset: Dataset) -> tuple[float, float, float]:
    return dataset.header.noise.station_mm


def _measured(readings: Readings) -> NDArray[np.bool_]:
    """(k n,) rows of the readings that were measured."""
    return np.any(readings.observed.whiten != 0.0, axis=1).reshape(-1)


def _by_joint(readings: Readings, frames: Frames, joints: Sequence[str]) -> Array:
    """(k n, N V) whitened change of the readings where one joint of one of V visits is off by a rad."""
    columns = readings.observed.columns(frames, joints)
    _, visit = np.unique(readings.conditions.visit, return_inverse=True)
    each = visit.reshape(-1) == np.arange(visit.max() + 1)[:, None]
    apart = (columns[:, None] * each[None, :, None, :]).reshape(-1, *columns.shape[1:])
    whitened = readings.observed.by_visit(apart)
    return whitened.reshape(len(whitened), -1).T


def _root(covariance: Array) -> Array:
    """(m, m) R with R R' = covariance, which may be singular."""
    values, vectors = np.linalg.eigh(covariance)
    return vectors * np.sqrt(np.maximum(values, 0.0))


def _length(columns: Array) -> Array:
    return np.maximum(np.linalg.norm(columns, axis=0), 1e-300) / np.sqrt(len(columns))
