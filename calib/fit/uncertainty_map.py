"""Map of the expanded uncertainty of a model's predictions over the whole workspace.

It shows where the model can be trusted. Poses are drawn evenly, half within the joint ranges that were
measured, half within the robot's limits. A joint that was hardly loaded, or a parameter that only its
prior determines, shows as a large U outside. (A UR10 whose fifth compliance was never loaded was 27 mm
off in one pose, without any other sign.) Source: GUM.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.arm.kinematics import forward
from calib.array import Array
from calib.fit.identification import IdentificationFit, expanded, radius_95
from calib.model.model import StatedConditions, conditions_at


@dataclass(frozen=True)
class UncertaintyMap:
    """Expanded uncertainty at N poses.

    Attributes
    ----------
    joints : array of shape (N, n)
        Model joints, rad.
    radius, height : array of shape (N,)
        Distance from axis 1, and height, mm.
    u : array of shape (N,)
        Expanded uncertainty, k = 2, in the worst direction, mm.
    radius_95 : array of shape (N,)
        Radius of the sphere that contains 95 % of the positions that the readings allow, mm.
    """

    joints: Array
    radius: Array
    height: Array
    u: Array
    radius_95: Array
    measured: NDArray[np.bool_]  # (N,) within the joint ranges of the readings


def uncertainty_map(found: IdentificationFit) -> UncertaintyMap:
    """Compute the map of an identified model.

    It holds for the first series, the target that was measured most, and the mean temperature and time
    of the readings.
    """
    readings = found.readings.conditions
    robot = found.model.robot
    rng = np.random.default_rng(0)
    low, high = readings.joints.min(axis=0), readings.joints.max(axis=0)
    drawn = [rng.uniform(a, b, (2000, robot.joints)) for a, b in ((low, high), (robot.lower, robot.upper))]
    joints = np.concatenate(drawn)
    stated = StatedConditions(
        temperature_c=_mean(readings.temperature),
        time_s=_mean(readings.time),
        loads=found.header.loads,
        gravity=found.header.gravity,
        series=readings.series_names[0],
    )
    seen = readings.target[readings.series == 0]
    target = readings.target_names[int(np.bincount(seen).argmax())]
    _, covariance = found.predict_with_covariance(conditions_at(found.model, joints, stated, target))
    place = forward(robot, joints)[:, :3, 3]
    return UncertaintyMap(
        joints=joints,
        radius=np.hypot(place[:, 0], place[:, 1]),
        height=place[:, 2],
        u=expanded(covariance),
        radius_95=radius_95(covariance),
        measured=np.all((joints >= low) & (joints <= high), axis=1),
    )


def _mean(values: Array) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else 0.0
