"""The mean over watches with forgetting (MEWMA), of residuals at the same poses against the same baseline.

    z_i = g r_i + (1 - g) z_(i-1),    z_0 = 0,

here divided by b_i = 1 - (1 - g)^i, so that a lasting change keeps its size. Noise and frame have the share
g / (2 - g) (1 - (1 - g)^(2 i)) / b_i^2 of their variance; what the baseline does not know is the same in every watch
and stays as it is. The covariance of each mean is known, so its chi-squared holds its rate of false alarms at every
watch, not an average run length. Source: Lowry et al. 1992.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array

WEIGHT = 0.2


@dataclass(frozen=True)
class Mean:
    """The mean residual (q,) of so many watches, and the share of the variance of noise that is left in it."""

    residual: Array
    share: float
    watches: int


def mean_of(residuals: Array) -> Mean:
    """The mean of residuals (i, q), oldest first, whitened by noise."""
    weights = WEIGHT * (1.0 - WEIGHT) ** np.arange(len(residuals))[::-1]
    total = float(np.sum(weights))
    return Mean(weights @ residuals / total, float(np.sum(weights**2)) / total**2, len(residuals))
