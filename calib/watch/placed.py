"""Readings in a frame of their own, laid over what the baseline predicts: the rigid motion that fits them best.

The rest of the frame is small then, and free by its derivative (`calib.watch.seen`). Source: Kabsch 1976.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from calib.arm.start import align
from calib.array import Array
from calib.data.dataset import Dataset
from calib.model.model import Design, RobotModel

_FEWEST = 3


def placed(dataset: Dataset, model: RobotModel, estimate: Array) -> Dataset:
    """The data set with points, turns and station where the usable points lie nearest to the predicted ones; as it is
    where there are fewer than three points."""
    rows = dataset.fit_rows & dataset.pointed
    if int(rows.sum()) < _FEWEST:
        return dataset
    predicted = Design(model, dataset.conditions.take(rows)).predict(estimate)
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
