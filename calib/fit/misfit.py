"""The refusal of fits that miss the readings, or that come out as another robot."""

from __future__ import annotations

import numpy as np

from calib.data.dataset import Dataset
from calib.data.hypotheses import reach
from calib.errors import DataError
from calib.fit.identification import Identification

_FAR = 0.05  # share of the extent of the measured points that a fitted robot may miss them by
_LEAST_MM = 10.0
_OTHER = 0.05  # share of the reach by which no length of a robot differs from its file
_SURE = 10.0  # standard errors of such a length
_NOISE = 10.0  # ratio of what is left to the declared noise below which the fit is no such matter


def refuse_misfit(dataset: Dataset, found: Identification) -> None:
    """Raise DataError where the fitted robot still misses most points by a twentieth of their extent, and where a
    length of it comes out as that of another robot.

    What one change of the files explains was refused before (`calib.data.plausible`); a zero that is 30 deg off, which
    nothing there explains, is fitted and passes. Where zeros are not freed, such as by `fit = ["base"]`, a far miss may
    be the very finding: nothing is refused.
    """
    _refuse_other_lengths(dataset, found)
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


def _refuse_other_lengths(dataset: Dataset, found: Identification) -> None:
    robot = found.model.robot
    far = _OTHER * reach(robot)
    columns = {f"{key}{k + 1}": (key, k) for key in "ad" for k in range(robot.joints)}
    beyond = [
        (name, getattr(robot, columns[name][0])[columns[name][1]], found.estimate[i])
        for name, i in found.model.index.items()
        if name in columns and abs(found.estimate[i]) > max(far, _SURE * found.standard_errors[i])
    ]
    if beyond:
        told = ", ".join(
            f"{name} = {nominal + change:.0f} mm instead of {nominal:.0f}" for name, nominal, change in beyond
        )
        raise DataError(
            f"the robot '{robot.name}' is not that of these readings: they would have {told}.",
            do="Name the robot that was measured, or correct the lengths in its robot file.",
            file=dataset.path.with_suffix(".toml"),
            key="robot",
        )
