"""Ties between the positions of balls of one body by the measured distances between them.

    residual  (L - |p - q|) / u,      derivative  e.(dp - dq) / u,   e the unit vector from q to p

p and q are the positions of the two balls as the model has them: nominal and, where they are parameters, their
estimate. The arm takes no part. Lengths mm.
"""

from __future__ import annotations

import numpy as np

from calib.array import Array
from calib.model.model import RobotModel


def ties(model: RobotModel, estimate: Array) -> tuple[Array, Array]:
    """Whitened residual (q,) of the distances between balls of a model, and its derivative of the prediction (q, m)."""
    residual = np.zeros(len(model.spans))
    columns = np.zeros((len(model.spans), len(model.parameters)))
    several = len(model.targets) > 1
    for row, span in enumerate(model.spans):
        places = model.targets[span.series] if span.series else model.anchors
        suffix = f"[{span.series}]" if span.series and several else ""
        between, moves = np.zeros(3), np.zeros((3, len(model.parameters)))
        for name, sign in ((span.one, 1.0), (span.other, -1.0)):
            between += sign * np.array(places[name])
            for k, axis in enumerate("xyz"):
                position = model.index.get(f"{name}{suffix}.{axis}", model.index.get(f"{name}.{axis}"))
                if position is not None:
                    between[k] += sign * estimate[position]
                    moves[k, position] = sign
        apart = float(np.linalg.norm(between))
        residual[row] = (span.length_mm - apart) / span.u_mm
        columns[row] = between @ moves / (max(apart, 1e-12) * span.u_mm)
    return residual, columns
