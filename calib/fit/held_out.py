"""The errors of a model on readings, as people judge them: how far the point, or the distance, is from measured."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.dataset import Dataset
from calib.model.model import Design, RobotModel


def errors_on(dataset: Dataset, rows: NDArray[np.bool_], model: RobotModel, estimate: Array) -> Array:
    """(k,) errors in mm of the measured rows of a mask (n,): 3D distance where a point was measured, else what a
    distance to a base target differs by."""
    frames = Design(model, dataset.conditions.take(rows)).frames(estimate, ())
    points = np.linalg.norm(dataset.points[rows].T - frames.p, axis=0)
    return np.where(dataset.pointed[rows], points, length_errors(dataset, rows, model, estimate))


def length_errors(dataset: Dataset, rows: NDArray[np.bool_], model: RobotModel, estimate: Array) -> Array:
    """(k,) by how many mm the distances of the rows of a mask (n,) differ from measured; NaN where none was."""
    return np.abs(length_differences(dataset, rows, model, estimate))


def length_differences(
    dataset: Dataset, rows: NDArray[np.bool_], model: RobotModel, estimate: Array
) -> Array:
    """(k,) the distances of the rows of a mask (n,), measured less predicted, mm; NaN where none was measured."""
    frames = Design(model, dataset.conditions.take(rows)).frames(estimate, ())
    lengths = np.linalg.norm(frames.p - frames.anchor, axis=0) + frames.length_zero
    return dataset.lengths[rows] - lengths
