"""The uncertainty of a prediction: the covariance of the parameters propagated to the tool point, C_p = J C J'.

It is small near the readings and large where the model extrapolates: a joint that was never loaded, a corner that was
never measured. It contains what the readings did not determine, not what the model lacks. Source: GUM, first-order
propagation.
"""

from __future__ import annotations

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.model.model import Design, RobotModel

_AT_ONCE = 1200  # points whose columns are in memory at a time


def predict_with_covariance(
    model: RobotModel, estimate: Array, covariance: Array, conditions: Conditions
) -> tuple[Array, Array]:
    """Points (n, 3), mm, and their covariances (n, 3, 3), mm2, from the covariance (m, m) of the estimate."""
    n = len(conditions)
    points, spread = np.empty((n, 3)), np.empty((n, 3, 3))
    for part in np.array_split(np.arange(n), max(-(-n // _AT_ONCE), 1)):
        design = Design(model, conditions.take(part))
        frames = design.frames(estimate, design.slots)
        columns = design.point_columns(frames).reshape(3, len(part), -1)
        points[part] = np.broadcast_to(frames.p, (3, len(part))).T
        spread[part] = np.einsum("anm,bnm->nab", columns @ covariance, columns, optimize=True)
    return points, spread


def expanded(covariance: Array) -> Array:
    """(n,) expanded uncertainty U of points with covariances (n, 3, 3): k = 2 along their worst direction, mm."""
    largest = np.linalg.eigvalsh(covariance)[:, -1]
    return 2.0 * np.sqrt(np.maximum(largest, 0.0))
