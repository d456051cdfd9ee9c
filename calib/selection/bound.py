"""The continuous D-optimal design over the candidates: a certified upper bound for every selection.

Weights w_i >= 0 of sum one in place of "taken or not": maximise log det sum w_i X_i'X_i. Multiplicative steps
w_i <- w_i (d_i / m)^power with d_i = tr(M^-1 X_i'X_i) (Silvey, Titterington and Torsney 1978); candidates that the
bound of Harman and Pronzato (2007) shows to be out of every optimum are left out meanwhile. For any weights
log det M + m log(max d_i / m), the maximum over all candidates, is above every design (trace and determinant of
M^-1/2 M' M^-1/2): so the figure given is a bound however far the steps have come.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.selection.pose_rows import PoseRows

TOLERANCE = 3e-4  # how far the bound may lie above the optimum, as a share of det^(1/m)
_STEPS = 5000
_POWER = 1.9  # 1 is the classic step; nearly twice its length is as sure and comes earlier
_EVERY = 10


@dataclass(frozen=True)
class Optimum:
    """The continuous optimum of N candidates.

    weights (N,); sensitivity (N,): d_i, at the optimum m where a candidate takes part and less elsewhere; log_det:
    the certified bound, in the blocks' own scale; gap: max d_i / m - 1, by which det^(1/m) of the bound may exceed
    the optimum.
    """

    weights: Array
    sensitivity: Array
    log_det: float
    gap: float

    def efficiency(self, log_det: float, count: int) -> float:
        """(det(M / count) / det of the bound)^(1/m) of a selection of `count` poses, from log det M.

        Its square root is the ratio of the two O1.
        """
        m = self.sensitivity @ self.weights  # tr(M^-1 M)
        return float(np.exp((log_det - self.log_det) / m) / count)


def optimum(blocks: PoseRows, tolerance: float = TOLERANCE) -> Optimum:
    """The continuous optimum, to a gap of `tolerance` or after a fixed number of steps: `gap` says which."""
    m = blocks.parameters
    left = np.arange(blocks.poses)
    few = blocks
    weights = np.full(blocks.poses, 1.0 / blocks.poses)
    for step in range(_STEPS):
        ratio = few.sensitivity(few.information(weights=weights)) / m
        gap = float(ratio.max()) - 1.0
        if gap < tolerance:
            break
        weights = weights * ratio**_POWER
        if step % _EVERY == 0:
            possible = ratio > 1.0 + gap / 2.0 - np.sqrt(gap * (4.0 + gap - 4.0 / m)) / 2.0
            left, weights, few = left[possible], weights[possible], few.take(possible)
        weights = weights / weights.sum()
    full = np.zeros(blocks.poses)
    full[left] = weights
    information = blocks.information(weights=full)
    sensitivity = blocks.sensitivity(information)
    excess = float(sensitivity.max()) / m
    log_det = float(np.linalg.slogdet(information)[1]) + m * float(np.log(excess))
    return Optimum(full, sensitivity, log_det, excess - 1.0)
