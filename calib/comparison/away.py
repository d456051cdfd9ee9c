"""A regression a few degrees away from its samples: at the same postures with one wrist joint turned.

There are no measurements there; the fitted model takes the place of the arm. A model of geometry carries over to such
postures, a regression on absolute positions has never seen its columns move, and a regression on residuals can only
add a little.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arm.kinematics import statics
from calib.array import Array
from calib.comparison.comparison import Comparison, Predictor
from calib.data.conditions import Conditions
from calib.data.header import Header
from calib.units import DEG

TURN = 5.0 * DEG
_WRIST = 3  # joints


@dataclass(frozen=True)
class Away:
    """Difference between a predictor and the fitted model at turned postures, mm, for the joint that is worst.

    inside: number of turned postures within the region of the regression, where it would be used.
    """

    name: str
    joint: int
    mean: float
    largest: float
    inside: float


def away(comparison: Comparison) -> tuple[Away, ...]:
    """The test with the wrist turned away, for every regression that was trained.

    A regression on positions is compared with the model of the level asked for."""
    predictors = {s.predictor.name: s.predictor for s in comparison.scored}
    conditions = comparison.dataset.conditions.take(comparison.rows)
    out = []
    for predictor in predictors.values():
        if predictor.regression is None:
            continue
        beside = predictors.get(f"level {comparison.plan.level}")
        model = (
            replace(predictor, regression=None) if predictor.regression.wanted.on == "residuals" else beside
        )
        if model is not None:
            out.append(_worst(predictor, model, conditions, comparison.dataset.header))
    return tuple(out)


def _worst(predictor: Predictor, model: Predictor, conditions: Conditions, header: Header) -> Away:
    assert predictor.regression is not None
    count = conditions.joints.shape[1]
    found = []
    for joint in range(max(0, count - _WRIST), count):
        turned = _turned(conditions, header, conditions.joints + TURN * np.eye(count)[joint])
        apart = np.linalg.norm(predictor.predict(turned) - model.predict(turned), axis=1)
        inside = float(predictor.regression.region.holds(turned.joints).mean())
        found.append(Away(predictor.name, joint + 1, float(apart.mean()), float(apart.max()), inside))
    return max(found, key=lambda each: each.mean)


def _turned(conditions: Conditions, header: Header, joints: Array) -> Conditions:
    """The conditions of the same readings at other joints (n, N), rad, with the loads of there."""
    load = statics(header.robot, joints, header.loads, header.gravity)
    return replace(
        conditions,
        joints=joints,
        previous=conditions.previous + joints - conditions.joints,
        torque=load.torque,
        moment=load.moment,
        overturning=load.overturning,
        unit_load=load.unit_load,
    )
