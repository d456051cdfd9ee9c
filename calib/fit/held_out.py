"""Errors of a model on readings, and held-out readings that are faulty.

Errors are the distances between predicted and measured points, or differences of distances, mm.

A held-out reading may belong to another tool target, or be a gross error. Such a reading says nothing
about the model, so the model's error is stated with and without it. The held-out readings are examined
after the fit and change nothing in it. Each is compared with its own prediction, whose uncertainty
counts, and with those of all other tool targets of its series.

The limit is the one for rejecting readings in a fit (`calib.fit.robust`), with the scale of the held-out
readings themselves. So a model that does not hold there makes no reading faulty.

The module also lists the readings that a fit left out, and their errors.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit import robust
from calib.fit.identification import IdentificationFit
from calib.fit.readings import FitReadings, linearised, readings_of
from calib.fit.robust import distances
from calib.fit.statistics import ErrorStatistics, statistics_of
from calib.model.model import BoundModel, ModelStructure


def errors_on(dataset: Dataset, rows: NDArray[np.bool_], model: ModelStructure, estimate: Array) -> Array:
    """Compute the errors of a model on the rows of a mask (n,), mm, shape (k,).

    The error is the 3D distance if a point was measured, otherwise the difference of the distance to a
    base target.
    """
    return errors_by(BoundModel(model, dataset.conditions.take(rows)), dataset, rows, estimate)


def errors_by(design: BoundModel, dataset: Dataset, rows: NDArray[np.bool_], estimate: Array) -> Array:
    """Compute the errors of `errors_on` with a model that is already bound to the rows.

    This saves time for many estimates of one model.
    """
    frames = design.frames(estimate, ())
    points = np.linalg.norm(dataset.points[rows].T - frames.p, axis=0)
    return np.where(dataset.pointed[rows], points, np.abs(_differences(frames, dataset, rows)))


def length_errors(dataset: Dataset, rows: NDArray[np.bool_], model: ModelStructure, estimate: Array) -> Array:
    """Compute the absolute errors of distances on the rows of a mask (n,), mm, shape (k,).

    They are NaN if no distance was measured.
    """
    return np.abs(length_differences(dataset, rows, model, estimate))


def length_differences(
    dataset: Dataset, rows: NDArray[np.bool_], model: ModelStructure, estimate: Array
) -> Array:
    """Compute measured minus predicted distances on the rows of a mask (n,), mm, shape (k,).

    They are NaN if no distance was measured.
    """
    return _differences(BoundModel(model, dataset.conditions.take(rows)).frames(estimate, ()), dataset, rows)


def _differences(frames: Frames, dataset: Dataset, rows: NDArray[np.bool_]) -> Array:
    lengths = np.linalg.norm(frames.p - frames.anchor, axis=0) + frames.length_zero
    return dataset.lengths[rows] - lengths


@dataclass(frozen=True)
class HeldOutFault:
    """A faulty held-out reading.

    Attributes
    ----------
    target : str
        Tool target that the file states.
    fits : str or None
        Tool target that the reading fits, if any.
    error_mm : float
        Error of the reading.
    """

    reading_id: str
    target: str
    fits: str | None
    error_mm: float


@dataclass(frozen=True)
class HeldOutFaults:
    """Faulty held-out readings, their mask (n,) in the data set, and the error of the rest, mm."""

    faults: tuple[HeldOutFault, ...]
    rows: NDArray[np.bool_]
    error_without: ErrorStatistics | None


def held_out_faults(dataset: Dataset, found: IdentificationFit) -> HeldOutFaults:
    """Examine the validation rows of a data set by a fitted model."""
    rows, faulty = dataset.validation_rows, np.zeros(len(dataset), dtype=np.bool_)
    if not rows.any():
        return HeldOutFaults((), faulty, None)
    readings = readings_of(dataset, rows, found.model, found.estimate)
    observed = readings.observed
    distance = _distances(found, readings)
    scale = max(robust.scale_of(distance, observed.freedom), 1.0)
    limit = robust.limits(observed.freedom) * scale
    suspects = np.flatnonzero(distance > limit)
    errors = errors_on(dataset, rows, found.model, found.estimate)
    fits: dict[int, str] = {}
    conditions = readings.conditions
    for t, name in enumerate(conditions.target_names):
        known = [name in found.model.targets[conditions.series_names[s]] for s in conditions.series[suspects]]
        trial = suspects[np.array(known, dtype=bool) & (conditions.target[suspects] != t)]
        if len(trial):
            few = readings.taken(trial)
            few = replace(few, conditions=replace(few.conditions, target=np.full(len(trial), t)))
            fits |= {int(i): name for i in trial[_distances(found, few) < limit[trial]] if int(i) not in fits}
    faulty[readings.rows[suspects]] = True
    return HeldOutFaults(
        tuple(
            HeldOutFault(
                dataset.reading_id[readings.rows[i]],
                conditions.target_names[conditions.target[i]],
                fits.get(int(i)),
                float(errors[i]),
            )
            for i in suspects
        ),
        faulty,
        statistics_of(errors[~faulty[rows]]),
    )


def _distances(found: IdentificationFit, readings: FitReadings) -> Array:
    """Compute standardised distances of readings from their predictions, shape (n,).

    The uncertainty of the predictions is included.
    """
    alone = replace(readings, observed=readings.observed.alone)
    noise = max(found.noise_scale, 1.0) ** 2
    out = np.zeros(len(readings.rows))
    for part, residual, columns in linearised(found.model, alone, found.estimate):
        k, n = residual.shape
        by_reading = columns.reshape(k, n, -1).transpose(1, 0, 2)
        spread = by_reading @ found.covariance @ by_reading.transpose(0, 2, 1) + noise * np.eye(k)
        solved = np.linalg.solve(spread, residual.T[:, :, None])[:, :, 0]
        out[part] = np.sqrt(np.maximum(np.sum(residual.T * solved, axis=1), 0.0))
    return out


@dataclass(frozen=True)
class ExcludedReading:
    """A reading that took no part in a fit.

    Attributes
    ----------
    joints_deg : tuple of float
        Controller joints, deg, or mm for joints that slide.
    error_mm : float
        Error of the reading.
    times_noise : float
        Error as a multiple of the declared noise: the length of the whitened residual.
    """

    reading_id: str
    joints_deg: tuple[float, ...]
    target: str
    error_mm: float
    times_noise: float


def all_readings(dataset: Dataset, fitted: IdentificationFit) -> tuple[FitReadings, NDArray[np.bool_]]:
    """Return all readings that may enter a fit, and the mask (n,) of those left out.

    Each has the target to which the fit assigned it.
    """
    readings = readings_of(dataset, dataset.fit_rows, fitted.model, fitted.estimate)
    left_out = ~np.isin(readings.rows, fitted.readings.rows)
    target = readings.conditions.target.copy()
    target[~left_out] = fitted.readings.conditions.target
    return replace(readings, conditions=replace(readings.conditions, target=target)), left_out


def left_out(dataset: Dataset, fitted: IdentificationFit) -> tuple[ExcludedReading, ...]:
    """List the readings that a fit left out, the worst first."""
    if not fitted.faulty_rows:
        return ()
    readings, out = all_readings(dataset, fitted)
    readings = readings.take(out)
    mask = np.zeros(len(dataset), dtype=np.bool_)
    mask[readings.rows] = True
    frames = BoundModel(fitted.model, readings.conditions).frames(fitted.estimate, ())
    lengths: Array = distances(readings.observed.alone.residual(frames))
    errors = errors_on(dataset, mask, fitted.model, fitted.estimate)
    header, conditions = dataset.header, readings.conditions
    angles = header.robot.controller_angles(conditions.joints, header.coupling) / header.robot.joint_units
    return tuple(
        ExcludedReading(
            dataset.reading_id[readings.rows[i]],
            tuple(np.round(angles[i], 4).tolist()),
            conditions.target_names[conditions.target[i]],
            float(errors[i]),
            float(lengths[i]),
        )
        for i in np.argsort(-lengths)
    )
