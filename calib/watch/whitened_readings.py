"""The view of a calibrated model on readings taken later: residuals, and why they may differ from nothing.

    r = measured - predicted = A x + J e + T w + F f + noise

x: what has changed. Nothing of the rest is a change: e ~ P is what the calibration left uncertain, of its own model and
of effects that this does not hold (`calib.saved.unresolved_effects`); w what the model was shown to lack by its own
validation, as if the joints scattered more (the same in every watch at the same poses); f the frame, set up
anew each time; and noise with the robot's repeatability. All rows are whitened by the noise as in a fit.

Readings in a frame of their own, laid over what the baseline predicts: the rigid motion that fits them best.

The rest of the frame is small then, and free by its derivative (`calib.watch.whitened_readings`). Source: Kabsch 1976.

The uncertainty of a world frame that is set up anew on its nests before every campaign.

A frame by 3-2-1 (`calib.arm.world_frame`) on nests that are measured with the covariances N_i each is off by a shift
and a turn with

    covariance sum J_i N_i J_i',    J_i: what an error of nest i does to them,

and so is the one of the calibration. Both together are what a watch may be off by with nothing changed. A frame that
is fitted to its nests would be less so: about z by 2.7 times in the variance on the corners of a square.

The error of the corrected robot at the check poses, with its U, to be compared with the permitted error.

    rms^2 = sum e_i^2 / n,    u(rms)^2 = sum g_i' N_i g_i + (J' g)' F (J' g),    g_i = e_i d_i / (n rms)

d_i: direction of the error e_i; N_i: what the instrument scatters by; F: covariance of its frame, J: what that moves.
The robot's own repeatability and what the model lacks are errors, and in no U.
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
_STEP_MM = 1e-3  # by which a nest is moved to see what its errors do


@dataclass(frozen=True)
class WhitenedReadings:
    """Readings of q measured rows as a baseline sees them, whitened by noise and repeatability.

    estimate (m,), covariance (m, m), plain (m,): the baseline's (`calib.watch.baseline`), internal units; residual
    (q,); lasting (q, a), passing (q, b): columns of unit variance of what stays the same from watch to watch, and of
    what is drawn anew; causes, and the columns (q, p) of each.
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
        """The usable readings of a data set. frame_known False: the positions of robot and instrument are not compared.

        lack (N,): what the model lacks, as scatter of every joint, rad; None: as `unmodelled_scatter` finds it.

        Raises DataError as the readers do; what makes them no watch of this robot is `refusals.refuse_unlike`'s.
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
        """(q, q) covariance of the residual with nothing changed; share: of the variance of noise and frame, below one
        for a mean over watches."""
        of_noise = np.eye(len(self.residual)) + self.passing @ self.passing.T
        return share * of_noise + self.lasting @ self.lasting.T

    @cached_property
    def measured(self) -> NDArray[np.bool_]:
        """(k n,) rows that were measured."""
        return _measured(self.readings)

    @cached_property
    def visit(self) -> NDArray[np.int64]:
        """(q,) to which visit each row belongs."""
        visit = self.readings.conditions.visit
        return np.tile(visit, len(self.measured) // len(visit))[self.measured]

    def lever_mm(self, joint: int) -> float | None:
        """The distance of the axis of a joint from the targets, root mean square over the readings; None of a slide."""
        robot = self.model.robot
        if joint in robot.slides:
            return None
        slot = robot.joint_slots[joint - 1]
        frames = BoundModel(self.model, self.readings.conditions).frames(self.estimate, (slot,))
        return float(np.sqrt(np.mean(np.sum(frames.velocities((slot,)) ** 2, axis=1))))

    def exact(self, cause: Effect, values: Array) -> Array:
        """(q,) residual where a cause has some values (p,), through the whole chain."""
        model = replace(self.model, effects=(*self.model.effects, cause.apart(_SINCE)))
        frames = BoundModel(model, self.readings.conditions).frames(
            np.concatenate([self.estimate, values]), ()
        )
        return self.readings.observed.residual(frames).reshape(-1)[self.measured]

    def displacement(self, cause: Effect) -> Array:
        """(3 n, p) derivative of the predicted points by the parameters of a cause, mm."""
        baseline = BoundModel(self.model, self.readings.conditions)
        design = BoundModel(
            ModelStructure(self.model.robot, (cause,), self.model.targets, anchors=self.model.anchors),
            self.readings.conditions,
        )
        return design.point_columns(baseline.frames(self.estimate, {*design.slots}))


_SINCE = "since"
_FREE = 1e4  # standard deviations of the noise by which an unknown frame may be elsewhere


def _causes(saved: CalibratedModel, dataset: Dataset, readings: FitReadings) -> tuple[Effect, ...]:
    """The causes that may have set in. Where the model has an effect already, its bounds hold for both together."""
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
    """(k n,) rows of the readings that were measured."""
    return np.any(readings.observed.whiten != 0.0, axis=1).reshape(-1)


def _by_joint(readings: FitReadings, frames: Frames, model: ModelStructure, lack: Array) -> Array:
    """(k n, N V) whitened change of the readings where one joint is off by its `lack` in one of V poses, in all visits
    to it; a slide by as many mm as others deg."""
    robot, pose = model.robot, readings.conditions.pose
    columns = (lack * robot.steps)[:, None, None] * readings.observed.columns(frames, robot.joint_slots)
    each = pose == np.arange(pose.max() + 1)[:, None]
    apart = (columns[:, None] * each[None, :, None, :]).reshape(-1, *columns.shape[1:])
    whitened = readings.observed.by_visit(apart)
    return whitened.reshape(len(whitened), -1).T


def _length(columns: Array) -> Array:
    return np.maximum(np.linalg.norm(columns, axis=0), 1e-300) / np.sqrt(len(columns))


def placed(dataset: Dataset, model: ModelStructure, estimate: Array) -> Dataset:
    """The data set with points, turns and station where the usable points lie nearest to the predicted ones; as it is
    where there are fewer than three points."""
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
    """The instrument's frame shifted, mm, and turned about the model's station, deg."""
    acts = {
        axis: ("mm" if len(axis) == 1 else "deg", None, [(f"frame.{axis}", Constant())])
        for axis in ("x", "y", "z", "rx", "ry", "rz")
    }
    return effect("frame", "instrument", "instrument", "The frame is set up anew.", acts)


def frame_covariance(
    nests: Mapping[str, tuple[float, float, float]], noise: Noise, centre: tuple[float, float, float]
) -> Array:
    """(6, 6) of shift, mm, and turn about `centre`, rad, of a frame on the first three of some nests; zero without
    three. Raises DataError where these lie in a line."""
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
    """RMS and largest of n errors, mm: of positions, or of distances where no point was measured; u: expanded
    uncertainty U (k = 2) of the RMS."""

    n: int
    rms: float
    max: float
    u: float


def missed(seen: WhitenedReadings, dataset: Dataset) -> CheckPoseErrors:
    """The errors of the readings of a watch against its baseline."""
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
