"""Readings that no parameter brings near the robot: of another robot, or columns that are not what they say."""

from __future__ import annotations

import numpy as np

from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.fit.identification import Identification

_FAR = 0.05  # share of the extent of the measured points that a fitted robot may miss them by
_LEAST_MM = 10.0
_NOISE = 10.0  # ratio of what is left to the declared noise below which the fit is no such matter


def refuse_misfit(dataset: Dataset, found: Identification) -> None:
    """Raise DataError where the fitted robot still misses most points by a twentieth of their extent.

    What one change of the files explains was refused before (`calib.data.plausible`); a zero that is 30 deg off, which
    nothing there explains, is fitted and passes. Where zeros are not freed, such as by `fit = ["base"]`, a far miss may
    be the very finding: nothing is refused.
    """
    zeros = set(found.model.robot.joint_slots)
    if found.noise_scale < _NOISE or not zeros & found.model.index.keys():
        return
    points = dataset.points[found.readings.rows]
    pointed = np.isfinite(points[:, 0])
    if not pointed.any():
        return
    points = points[pointed]
    predicted = found.predict(found.readings.conditions.take(pointed))
    miss = float(np.median(np.linalg.norm(points - predicted, axis=1)))
    extent = float(np.linalg.norm(np.std(points, axis=0)))
    if miss <= max(_FAR * extent, _LEAST_MM):
        return
    raise DataError(
        f"the robot '{dataset.header.robot.name}' does not fit these readings: with its parameters fitted it still "
        f"misses half of them by {miss:.3g} mm or more, where the points spread by {extent:.3g} mm.",
        do="Check whether it is this robot; then its file, the order, signs and zeros of the joint columns, and that "
        "every row holds joints and point of one moment.",
        file=dataset.path.with_suffix(".toml"),
        key="robot",
    )
