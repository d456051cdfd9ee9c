"""Residuals of later readings against a calibrated model, and their causes and covariance.

    r = measured - predicted = A x + J e + T w + F f + noise

x is what has changed. The other terms are no change:

- e ~ P is the uncertainty of the calibration, of its model and of effects that the model does not include
  (`calib.saved.unresolved_effects`).
- w is the unmodelled scatter that the validation of the model has shown. It acts as additional scatter of the joints
  that is the same in every watch at the same poses.
- f is the frame, which is set up again for each watch.
- The noise includes the robot's repeatability. All rows are whitened by the noise as in a fit.

**Free frame.** Readings in a separate frame are placed on the predictions of the baseline by the best rigid motion
(`placed`). The remaining error of the frame is small and is freed by its derivative. Source: Kabsch 1976.

**Uncertainty of the frame.** The world frame is set up again on its nests before every campaign. A frame by 3-2-1
(`calib.arm.world_frame`) on nests that are measured with the covariances N_i is off by a shift and a turn with

    covariance sum J_i N_i J_i',    J_i: derivative of shift and turn by the position of nest i,

and so is the frame of the calibration. A watch of an unchanged robot may be off by both together. A frame that is
fitted to its nests would be less uncertain: about z, on the corners of a square, by a factor of 2.7 in the variance.

**Check pose errors.** The error of the corrected robot at the check poses has an uncertainty U, so that it can be
compared with the permitted error.

    rms^2 = sum e_i^2 / n,    u(rms)^2 = sum g_i' N_i g_i + (J' g)' F (J' g),    g_i = e_i d_i / (n rms)

Here d_i is the direction of the error e_i and N_i the covariance of the instrument. F is the covariance of its frame,
and J the derivative of the points by the frame. The robot's repeatability and the unmodelled scatter are errors, and
are not part of U.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calib.arm.kinematics import Frames
from calib.arm.start import align
from calib.arm.world_frame import by_three_two_one, frame_of
from calib.array import Array
from calib.data.dataset import Dataset
from calib.data.noise import Noise
from calib.effects import Survey, changes, compliance_of
from calib.errors import DataError
from calib.fit.least_squares import jacobian
from calib.fit.readings import FitReadings, readings_of
from calib.model.effect import Effect, effect
from calib.model.model import BoundModel, ModelStructure
from calib.model.regressors import Constant
from calib.saved import CalibratedModel
from calib.watch.baseline import Baseline, in_series, root_of, unmodelled_scatter

_FEWEST = 3
_STEP_MM = 1e-3  # step of a nest for the numerical derivative


@dataclass(frozen=True)
class WhitenedReadings:
    """Residuals of q measured rows against a baseline, whitened by noise and repeatability.

    Attributes
    ----------
    estimate, covariance, plain : array of shape (m,), (m, m) and (m,)
        Those of the baseline (`calib.watch.baseline`), internal units.
    residual : array of shape (q,)
        Whitened residual.
    lasting : array of shape (q, a)
        Columns of unit variance of the errors that are the same in every watch.
    passing : array of shape (q, b)
        Columns of unit variance of the errors that differ from watch to watch.
    causes : tuple of Effect
        Possible causes of a change.
    columns : tuple of array of shape (q, p)
        Columns of each cause.
    """

    model: ModelStructure
    estimate: Array
    covariance: Array
    plain: Array
    readings: FitReadings
    residual: Array
    of_parameters: Array  # (q, m)
    lasting: Array
    passing: Array
    causes: tuple[Effect, ...]
    columns: tuple[Array, ...]

    @classmethod
    def of(
        cls, saved: CalibratedModel, dataset: Dataset, *, frame_known: bool = True, lack: Array | None = None
    ) -> WhitenedReadings:
        """Whiten the usable readings of a data set.

        Call `refusals.refuse_unlike` to check that the readings are a watch of this robot.

        Parameters
        ----------
        frame_known : bool, optional
            False if the positions of robot and instrument cannot be compared with the calibration.
        lack : array of shape (N,), optional
            Unmodelled scatter of every joint, rad. Default: from `unmodelled_scatter`.

        Raises
        ------
        DataError
            As raised by the readers of the data set.
        """
        dataset = in_series(saved, dataset)
        baseline = Baseline.of(saved)
        model, estimate, covariance = baseline.model, baseline.estimate, baseline.covariance
        dataset = dataset if frame_known else placed(dataset, model, estimate)
        readings = readings_of(dataset, dataset.fit_rows, model, estimate)
        design = BoundModel(model, readings.conditions)
        causes = _causes(saved, dataset, readings)
        frame = frame_effect()
        others = ModelStructure(
            model.robot,
            (*(cause.apart(_SINCE) for cause in causes), frame),
            model.targets,
            anchors=model.anchors,
        )
        beside = BoundModel(others, readings.conditions)
        joints = model.robot.joint_slots
        frames = design.frames(estimate, {*design.slots, *beside.slots, *joints})
        measured = _measured(readings)
        of_parameters = jacobian(design, readings.observed, frames)[measured]
        of_others = jacobian(beside, readings.observed, frames)[measured]
        ends = np.cumsum([0, *(len(cause.parameters) for cause in causes)])
        of_causes = tuple(of_others[:, a:b] for a, b in pairwise(ends))
        header = dataset.header
        of_frame = of_others[:, ends[-1] :] @ root_of(
            frame_covariance(header.nests, header.noise, model.station)
        )
        lack = unmodelled_scatter(saved, dataset) if lack is None else lack
        lasting = np.column_stack([of_parameters @ root_of(covariance), of_frame])
        if lack.any():
            lasting = np.column_stack([lasting, _by_joint(readings, frames, model, lack)[measured]])
        passing = of_frame
        if not frame_known:
            where = next(c for e, c in zip(causes, of_causes, strict=True) if e.label == "base_shift")
            passing = np.column_stack([passing, _FREE * where / _length(where)])
        residual = readings.observed.residual(frames).reshape(-1)[measured]
        return cls(
            model,
            estimate,
            covariance,
            baseline.plain,
            readings,
            residual,
            of_parameters,
            lasting,
            passing,
            causes,
            of_causes,
        )

    def spread(self, share: float = 1.0) -> Array:
        """Compute the covariance (q, q) of the residual of an unchanged robot.

        The variance of noise and frame is multiplied by `share`, which is below one for a mean over watches.
        """
        of_noise = np.eye(len(self.residual)) + self.passing @ self.passing.T
        return share * of_noise + self.lasting @ self.lasting.T

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """Mask of the rows that were measured, shape (k n,)."""
        return _measured(self.readings)

    @cached_property
    def visit(self) -> NDArray[np.int64]:
        """Visit that each row belongs to, shape (q,)."""
        visit = self.readings.conditions.visit
        return np.tile(visit, len(self.measured) // len(visit))[self.measured]

    def lever_mm(self, joint: int) -> float | None:
        """Return the RMS distance of a joint's axis from the targets, mm; None for a sliding joint."""
        robot = self.model.robot
        if joint in robot.slides:
            return None
        slot = robot.joint_slots[joint - 1]
        frames = BoundModel(self.model, self.readings.conditions).frames(self.estimate, (slot,))
        return float(np.sqrt(np.mean(np.sum(frames.velocities((slot,)) ** 2, axis=1))))

    def exact(self, cause: Effect, values: Array) -> Array:
        """Compute the residual (q,) through the whole chain for given values (p,) of a cause."""
        model = replace(self.model, effects=(*self.model.effects, cause.apart(_SINCE)))
        frames = BoundModel(model, self.readings.conditions).frames(
            np.concatenate([self.estimate, values]), ()
        )
        return self.readings.observed.residual(frames).reshape(-1)[self.measured]

    def displacement(self, cause: Effect) -> Array:
        """Differentiate the predicted points by the parameters of a cause, mm, shape (3 n, p)."""
        baseline = BoundModel(self.model, self.readings.conditions)
        design = BoundModel(
            ModelStructure(self.model.robot, (cause,), self.model.targets, anchors=self.model.anchors),
            self.readings.conditions,
        )
        return design.point_columns(baseline.frames(self.estimate, {*design.slots}))


_SINCE = "since"
_FREE = 1e4  # prior of an unknown frame, in standard deviations of the noise


def _causes(saved: CalibratedModel, dataset: Dataset, readings: FitReadings) -> tuple[Effect, ...]:
    """List the possible causes. If the model has an effect already, its bounds apply to the sum of both."""
    model, estimate = saved.model, saved.estimate
    survey = Survey(
        robot=model.robot,
        conditions=readings.conditions,
        compliance=compliance_of(model, estimate),
        loads=saved.loads,
        station=_station(dataset),
    )
    return tuple(_beyond(cause, model, estimate) for cause in changes(survey))


def _beyond(cause: Effect, model: ModelStructure, estimate: Array) -> Effect:
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


def _station(dataset: Dataset) -> tuple[float, float, float]:
    return dataset.header.noise.station_mm


def _measured(readings: FitReadings) -> NDArray[np.bool_]:
    """Mark the rows of the readings that were measured, shape (k n,)."""
    return np.any(readings.observed.whiten != 0.0, axis=1).reshape(-1)


def _by_joint(readings: FitReadings, frames: Frames, model: ModelStructure, lack: Array) -> Array:
    """Compute the whitened change of the readings if one joint is off in one pose, (k n, N V).

    The joint is off by its `lack`, in all visits to that one of the V poses. A sliding joint is off by as many mm as
    deg.
    """
    robot, pose = model.robot, readings.conditions.pose
    columns = (lack * robot.steps)[:, None, None] * readings.observed.columns(frames, robot.joint_slots)
    each = pose == np.arange(pose.max() + 1)[:, None]
    apart = (columns[:, None] * each[None, :, None, :]).reshape(-1, *columns.shape[1:])
    whitened = readings.observed.by_visit(apart)
    return whitened.reshape(len(whitened), -1).T


def _length(columns: Array) -> Array:
    return np.maximum(np.linalg.norm(columns, axis=0), 1e-300) / np.sqrt(len(columns))


def placed(dataset: Dataset, model: ModelStructure, estimate: Array) -> Dataset:
    """Place points, orientations and station so that the points are nearest to the predictions.

    With fewer than three usable points the data set is returned unchanged.
    """
    rows = dataset.fit_rows & dataset.pointed
    if int(rows.sum()) < _FEWEST:
        return dataset
    predicted = BoundModel(model, dataset.conditions.take(rows)).predict(estimate)
    measured = dataset.points[rows]
    rotation, shift = align(measured, predicted, np.ones(len(measured)))
    turn = Rotation.from_matrix(rotation)
    points = dataset.points.copy()
    points[dataset.pointed] = turn.apply(points[dataset.pointed]) + shift
    orientation = dataset.orientation.copy()
    turned = np.isfinite(orientation[:, 0])
    if turned.any():
        felt = turn * Rotation.from_quat(orientation[turned], scalar_first=True)
        orientation[turned] = felt.as_quat(scalar_first=True)
    noise = dataset.header.noise
    x, y, z = (turn.apply(noise.station_mm) + shift).tolist()
    header = replace(dataset.header, noise=replace(noise, station_mm=(x, y, z)))
    return replace(dataset, header=header, points=points, orientation=orientation)


def frame_effect() -> Effect:
    """Return the effect of a shift, mm, and a turn, deg, of the instrument's frame.

    The frame turns about the station of the model.
    """
    acts = {
        axis: ("mm" if len(axis) == 1 else "deg", None, [(f"frame.{axis}", Constant())])
        for axis in ("x", "y", "z", "rx", "ry", "rz")
    }
    return effect("frame", "instrument", "instrument", "The frame is set up anew.", acts)


def frame_covariance(
    nests: Mapping[str, tuple[float, float, float]], noise: Noise, centre: tuple[float, float, float]
) -> Array:
    """Compute the covariance of a frame that is set up on its first three nests.

    Returns
    -------
    array of shape (6, 6)
        Covariance of the shift, mm, and of the turn about `centre`, rad. Zero for fewer than three nests.

    Raises
    ------
    DataError
        The nests lie on a line.
    """
    if len(nests) < 3:
        return np.zeros((6, 6))
    try:
        frame_of(np.array(list(nests.values())[:3]))
    except ValueError as error:
        raise DataError(
            f"are nests in a line ({', '.join(list(nests)[:3])}), which span no frame.",
            do="Name first three nests that do not lie in a line.",
            key="nests",
        ) from error
    places, about = np.array(list(nests.values())[:3]), np.array(centre)
    covariance = noise.of_points(places, np.full(places.shape, np.nan))
    off = np.zeros((6, 3, 3))
    for nest, axis in np.ndindex(3, 3):
        measured = places.copy()
        measured[nest, axis] += _STEP_MM
        frame = by_three_two_one(measured, places)
        turn = Rotation.from_matrix(frame.rotation).as_rotvec()
        off[:, nest, axis] = np.concatenate([frame.to_world(about) - about, turn]) / _STEP_MM
    return np.einsum("ani,nij,bnj->ab", off, covariance, off)


@dataclass(frozen=True)
class CheckPoseErrors:
    """Errors of n check readings, mm.

    The errors are position errors, or length errors for measured distances.

    Attributes
    ----------
    rms, max : float
        RMS and largest error.
    u : float
        Expanded uncertainty U (k = 2) of the RMS.
    """

    n: int
    rms: float
    max: float
    u: float


def missed(seen: WhitenedReadings, dataset: Dataset) -> CheckPoseErrors:
    """Compute the errors of the readings of a watch compared with its baseline."""
    rows = seen.readings.rows
    design = BoundModel(seen.model, seen.readings.conditions)
    frames = design.frames(seen.plain, {*design.slots})
    pointed = dataset.pointed[rows]
    off = dataset.points[rows].T - frames.p  # (3, n), NaN where a distance was measured
    lengths = dataset.lengths[rows] - np.linalg.norm(frames.p - frames.anchor, axis=0) - frames.length_zero
    errors = np.where(pointed, np.linalg.norm(off, axis=0), np.abs(lengths))
    n, rms = len(errors), float(np.sqrt(np.mean(errors**2)))
    if rms == 0.0:
        return CheckPoseErrors(n, 0.0, 0.0, 0.0)
    noise = dataset.header.noise
    g = np.where(pointed, off, 0.0) / (n * rms)
    of_points = noise.of_points(dataset.points[rows][pointed], dataset.u_point[rows][pointed])
    variance = float(np.einsum("in,nij,jn->", g[:, pointed], of_points, g[:, pointed]))
    others = ModelStructure(
        seen.model.robot, (frame_effect(),), seen.model.targets, anchors=seen.model.anchors
    )
    by_frame = BoundModel(others, seen.readings.conditions)
    moved = by_frame.point_columns(design.frames(seen.plain, {*design.slots, *by_frame.slots}))
    turn = moved.T @ g.reshape(-1)
    variance += float(turn @ frame_covariance(dataset.header.nests, noise, seen.model.station) @ turn)
    given = dataset.u_length[rows]
    of_lengths = np.where(np.isfinite(given), given, noise.length_mm)
    variance += float(np.sum((errors * of_lengths / (n * rms))[~pointed] ** 2))
    return CheckPoseErrors(n, rms, float(errors.max()), 2.0 * float(np.sqrt(variance)))
