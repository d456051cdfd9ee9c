"""The map of where a model can be trusted: the expanded uncertainty of its predictions over the whole workspace.

Poses drawn evenly, half within the joint ranges that were measured, half within the robot's limits. A joint that was
hardly loaded, or a parameter that only its prior determines, shows as a large U outside. Source: GUM. (A UR10 whose
fifth compliance was never loaded was 27 mm off in one pose, without any other sign.)
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
    """N poses: joints (N, n) rad; radius (N,) from axis 1 and height (N,), mm; u (N,) mm, k = 2, worst direction;
    radius_95 (N,) mm: of the sphere that contains 95 % of the positions that the readings allow."""

    joints: Array
    radius: Array
    height: Array
    u: Array
    radius_95: Array
    measured: NDArray[np.bool_]  # (N,) within the joint ranges of the readings


def uncertainty_map(found: IdentificationFit) -> UncertaintyMap:
    """The map of an identified model, for its first series and the target that was measured most, side by side with
    the conditions of its readings (their mean temperature and time)."""
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
