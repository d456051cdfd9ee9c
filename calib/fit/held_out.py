"""The errors of a model on readings, mm: predicted against measured points or distances."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.data.dataset import Dataset
from calib.model.model import Design, RobotModel


def errors_on(dataset: Dataset, rows: NDArray[np.bool_], model: RobotModel, estimate: Array) -> Array:
    """(k,) errors in mm of the measured rows of a mask (n,): 3D distance where a point was measured, else what a
    distance to a base target differs by."""
    return errors_by(Design(model, dataset.conditions.take(rows)), dataset, rows, estimate)


def errors_by(design: Design, dataset: Dataset, rows: NDArray[np.bool_], estimate: Array) -> Array:
    """The errors of `errors_on`, by a model that is bound to the rows already: for many estimates of one model."""
    frames = design.frames(estimate, ())
    points = np.linalg.norm(dataset.points[rows].T - frames.p, axis=0)
    return np.where(dataset.pointed[rows], points, np.abs(_differences(frames, dataset, rows)))


def length_errors(dataset: Dataset, rows: NDArray[np.bool_], model: RobotModel, estimate: Array) -> Array:
    """(k,) by how many mm the distances of the rows of a mask (n,) differ from measured; NaN where none was."""
    return np.abs(length_differences(dataset, rows, model, estimate))


def length_differences(
    dataset: Dataset, rows: NDArray[np.bool_], model: RobotModel, estimate: Array
) -> Array:
    """(k,) the distances of the rows of a mask (n,), measured less predicted, mm; NaN where none was measured."""
    return _differences(Design(model, dataset.conditions.take(rows)).frames(estimate, ()), dataset, rows)


def _differences(frames: Frames, dataset: Dataset, rows: NDArray[np.bool_]) -> Array:
    lengths = np.linalg.norm(frames.p - frames.anchor, axis=0) + frames.length_zero
    return dataset.lengths[rows] - lengths
