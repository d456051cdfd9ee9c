"""How sure a prediction is: the parameters' covariance carried to the tool point, C_p = J C J'.

Small where the readings were, large where the model extrapolates: a joint that was never loaded, a corner that was
never measured. It holds what the readings could not tell, not what the model lacks. Source: GUM, first-order
propagation.
"""

from __future__ import annotations

import numpy as np

from calib.conditions import Conditions
from calib.kinematics import Array
from calib.model import Design, RobotModel


def predict_with_covariance(
    model: RobotModel, estimate: Array, covariance: Array, conditions: Conditions
) -> tuple[Array, Array]:
    """Points (n, 3), mm, and their covariances (n, 3, 3), mm2, from the covariance (m, m) of the estimate."""
    design = Design(model, conditions)
    frames = design.frames(estimate, design.slots)
    n = len(conditions)
    columns = design.point_columns(frames).reshape(3, n, -1)
    through = columns @ covariance
    points = np.broadcast_to(frames.p, (3, n)).T.copy()
    return points, np.einsum("anm,bnm->nab", through, columns, optimize=True)


def expanded(covariance: Array) -> Array:
    """(n,) expanded uncertainty U of points with covariances (n, 3, 3): k = 2 along their worst direction, mm."""
    largest = np.linalg.eigvalsh(covariance)[:, -1]
    return 2.0 * np.sqrt(np.maximum(largest, 0.0))
