"""The worth of an updated model: how uncertain its predictions are beside those of its baseline.

A recalibration by the campaign of the baseline would be about as uncertain as that is. An update keeps what the
baseline did not know and adds what few readings leave open of the change; at the check poses it is as sure as they
are, so it is asked elsewhere: at random poses within the limits of the robot.
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
    """Uncertainty of the positions of some targets by an updated model over that by its baseline, root mean square over
    random poses; NaN where a model needs a condition that nobody stated, or is not uncertain at all."""
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
