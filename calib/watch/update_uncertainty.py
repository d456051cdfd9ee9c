"""Uncertainty of the predictions of an updated model compared with its baseline.

A recalibration with the campaign of the baseline would be about as uncertain as the baseline. An update keeps the
uncertainty of the baseline and adds the uncertainty of the change, which has few readings. At the check poses the
update is as certain as these readings, so the comparison uses random poses within the limits of the robot.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array import Array
from calib.data.header import Header
from calib.model.model import BoundModel
from calib.saved import CalibratedModel
from calib.units import DEG
from calib.watch.planning.planned import PlannedVisits, planned

DOUBTFUL = 1.2
"""Times the uncertainty of a recalibration, beyond which an update is said to be worth less than one."""

_POSES = 200


def times_as_uncertain(
    saved: CalibratedModel, updated: CalibratedModel, header: Header, targets: Sequence[str]
) -> float:
    """Compute the position uncertainty of an updated model divided by that of its baseline.

    Both are the root mean square over random poses and the given targets.

    Returns
    -------
    float
        The ratio. NaN if a model needs a condition that was not stated, or if the baseline has no uncertainty.
    """
    robot, rng = saved.model.robot, np.random.default_rng(3)
    joints = rng.uniform(robot.lower, robot.upper, (_POSES, robot.joints))
    sides = rng.choice((-1.0, 1.0), size=joints.shape)
    visits = PlannedVisits.of_points(joints, sides, np.full(_POSES, 5.0 * DEG), targets)
    points = planned(saved, header, visits)
    after, before = (_variance(each, BoundModel(each.model, points.conditions)) for each in (updated, saved))
    return float(np.sqrt(after / before)) if before > 0.0 else float("nan")


def _variance(saved: CalibratedModel, design: BoundModel) -> float:
    columns: Array = design.point_columns(design.frames(saved.estimate, {*design.slots}))
    return float(np.sum((columns @ saved.covariance) * columns))
