"""A model without some of its effects, with all other parameters adapted as a new fit would, to first order.

With x the estimate, C its covariance and e the parameters of the effects, x - C_e C_ee^-1 x_e is the estimate under the
condition that these effects are zero, and C - C_e C_ee^-1 C_e' its covariance.
"""

from __future__ import annotations

from collections.abc import Collection

import numpy as np

from calib.array import Array
from calib.model.effect import Effect
from calib.model.model import RobotModel

Reduced = tuple[RobotModel, Array, Array]
"""Model, estimate (m,) and covariance (m, m) in internal units."""


def conditional(
    model: RobotModel, estimate: Array, covariance: Array, effects: Collection[Effect]
) -> tuple[Array, Array]:
    """Estimate (m,) and covariance (m, m) of a whole model under the condition that some effects are zero."""
    gone = [i for effect in effects for i in model.positions(effect)]
    live = [i for i in gone if covariance[i, i] > 0.0]
    scale = np.sqrt(np.diag(covariance)[live])
    within = covariance[np.ix_(live, live)] / np.outer(scale, scale)
    pull = np.linalg.lstsq(within, covariance[live] / scale[:, None], rcond=None)[0] / scale[:, None]
    estimate, covariance = estimate - estimate[live] @ pull, covariance - covariance[:, live] @ pull
    estimate[gone], covariance[gone], covariance[:, gone] = 0.0, 0.0, 0.0
    return estimate, covariance


def without(model: RobotModel, estimate: Array, covariance: Array, effects: Collection[Effect]) -> Reduced:
    """The model without some effects; estimate and covariance (m,), (m, m) in internal units become smaller."""
    if not effects:
        return model, estimate, covariance
    estimate, covariance = conditional(model, estimate, covariance, effects)
    less = model.without(*(effect.label for effect in effects))
    kept = [model.index[p.name] for p in less.parameters]
    return less, estimate[kept], covariance[np.ix_(kept, kept)]


def named_only(model: RobotModel, estimate: Array, covariance: Array) -> Reduced:
    """The model without its carried terms."""
    return without(model, estimate, covariance, [e for e in model.effects if e.is_carried])
