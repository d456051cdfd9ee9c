"""Readings that do not belong: weights that keep them from steering the fit, and the test that rejects them.

Distances are norms of whitened 3-vectors. The scale is the larger of what the median and what the 90 % quantile
say, so that a tenth of the readings may be wrong, while a structure that moves many readings (a step, a drift)
is not mistaken for a crowd of outliers. Source: Huber 1981; Beaton and Tukey 1974 (bisquare).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calib.kinematics import Array

_HUBER = 2.8  # 95 % of a chi distribution with three degrees of freedom lie below
_BISQUARE = 7.0


def distances(residual: Array) -> Array:
    """(n,) norm of every whitened reading, from (k, n) residuals."""
    return np.sqrt(np.sum(residual**2, axis=0))


def noise_scale(residual: Array) -> float:
    """Robust ratio of the residuals to the declared noise, from (k, n) whitened residuals."""
    distance = distances(residual)
    return max(float(np.quantile(distance, q)) / _chi(len(residual), q) for q in (0.5, 0.9))


@cache
def _chi(rows: int, quantile: float) -> float:
    return float(stats.chi(rows).ppf(quantile))


def huber(residual: Array) -> Array:
    """(n,) weights 1 within, k/d beyond."""
    distance = distances(residual) / max(noise_scale(residual), 1e-300)
    return np.minimum(1.0, _HUBER / np.maximum(distance, 1e-300))


def bisquare(residual: Array) -> Array:
    """(n,) weights that fall to zero at 7 times the noise."""
    distance = distances(residual) / max(noise_scale(residual), 1e-300)
    return np.maximum(1.0 - (distance / _BISQUARE) ** 2, 0.0) ** 2


def threshold(residual: Array) -> float:
    """Distance beyond which, with 99 % confidence over all n readings, a reading does not belong."""
    rows, n = residual.shape
    return float(np.sqrt(stats.chi2.isf(0.01 / n, rows))) * max(noise_scale(residual), 1.0)


def outliers(residual: Array) -> NDArray[np.bool_]:
    """(n,) readings beyond the threshold."""
    return distances(residual) > threshold(residual)
