"""Robust weights that limit the influence of outliers, and the test that rejects them.

Distances are norms of whitened readings, each judged by the chi distribution of as many degrees of
freedom as it has rows (a point 3, a pose 6, a length 1). The scale is the larger of those from the
median and from the 90 % quantile. So a tenth of the readings may be wrong, while a structure that moves
many readings (a step, a drift) is not mistaken for a crowd of outliers. If a crowd is suspected, `wrong`
is the share of the readings that may be wrong.

Sources: Huber 1981, Beaton and Tukey 1974 (bisquare).
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri, gammaincinv

from calib.array import Array

_HUBER = 0.95  # quantile of the noise within which a reading counts in full
_BISQUARE = 2.5  # times that distance: where a reading stops counting
_REJECT = 0.01  # chance that a clean set has a reading rejected
_TOGETHER = 3.5  # standard deviations by which the number of runs is too small for chance
# Share of the readings that may be wrong: as a rule, and where a crowd of them is suspected
FEW, CROWD = 0.1, 0.25

Freedom = NDArray[np.int64]


def distances(residual: Array) -> Array:
    """Compute the norm of every whitened reading from residuals (k, n), shape (n,)."""
    return np.sqrt(np.sum(residual**2, axis=0))


def noise_scale(residual: Array, freedom: Freedom, wrong: float = FEW) -> float:
    """Estimate the ratio of the residuals (k, n) to the declared noise, robustly.

    `freedom` (n,) is the number of rows of every reading.
    """
    return scale_of(distances(residual), freedom, wrong)


def scale_of(distance: Array, freedom: Freedom, wrong: float = FEW) -> float:
    """Robust ratio of distances (n,) to those of noise as declared."""
    largest = 0.0
    for q in (0.5, 1.0 - wrong):
        ratio = distance / _chi(freedom, q)
        place = round(q * (len(ratio) - 1))
        largest = max(largest, float(np.partition(ratio, place)[place]))
    return largest


def _chi(freedom: Freedom, quantile: float) -> Array:
    """Compute a quantile of the chi distribution for every reading, shape (n,)."""
    values = np.array([_quantile(rows, quantile) for rows in range(int(freedom.max()) + 1)])
    return values[freedom]


@cache
def _quantile(rows: int, quantile: float) -> float:
    return float(np.sqrt(2.0 * gammaincinv(0.5 * rows, quantile))) if rows else 1.0


def huber(residual: Array, freedom: Freedom, wrong: float = FEW) -> Array:
    """Compute Huber's weights, shape (n,): 1 within the limit k, k / d beyond it.

    d is the distance of a reading.
    """
    distance = distances(residual) / max(noise_scale(residual, freedom, wrong), 1e-300)
    return np.minimum(1.0, _chi(freedom, _HUBER) / np.maximum(distance, 1e-300))


def bisquare(residual: Array, freedom: Freedom, wrong: float = FEW) -> Array:
    """Compute bisquare weights, shape (n,).

    They fall to zero at 2.5 times the distance within which 95 % of the noise lies.
    """
    distance = distances(residual) / max(noise_scale(residual, freedom, wrong), 1e-300)
    return np.maximum(1.0 - (distance / (_BISQUARE * _chi(freedom, _HUBER))) ** 2, 0.0) ** 2


def threshold(residual: Array, freedom: Freedom, wrong: float = FEW) -> Array:
    """Compute the distance beyond which a reading does not belong, shape (n,).

    It holds with 99 % confidence over all n readings.
    """
    return limits(freedom) * max(noise_scale(residual, freedom, wrong), 1.0)


def limits(freedom: Freedom) -> Array:
    """Compute the distance that declared noise exceeds in 1 % of all clean sets, shape (n,).

    A clean set exceeds it if one of its n readings does.
    """
    values = np.array([_limit(rows, _REJECT / len(freedom)) for rows in range(int(freedom.max()) + 1)])
    return values[freedom]


@cache
def _limit(rows: int, chance: float) -> float:
    return float(np.sqrt(chdtri(rows, chance))) if rows else 0.0


def outliers(residual: Array, freedom: Freedom, wrong: float = FEW) -> NDArray[np.bool_]:
    """Mark the readings beyond the threshold, shape (n,)."""
    return distances(residual) > threshold(residual, freedom, wrong)


def suspicious(distance: Array, freedom: Freedom) -> bool:
    """Test whether readings that do not belong may have steered a plain fit.

    `distance` (n,) are the standardised lengths of its residuals. A clean set that is suspected, one in
    a hundred, loses only the time of a robust fit.
    """
    return bool(np.any(distance > limits(freedom) * scale_of(distance, freedom)))


def lie_together(out: NDArray[np.bool_], along: Array) -> bool:
    """Test whether the readings of a mask (n,) lie together along a quantity of `along` (n, q).

    Such quantities are the time or a joint angle. Along each quantity runs of readings inside and
    outside the mask alternate; few runs are no chance. Source: Wald and Wolfowitz 1940.
    """
    n, inside = len(out), int(out.sum())
    if not 0 < inside < n:
        return False
    sorted_out = out[np.argsort(along, axis=0, kind="stable")]
    runs = 1 + np.sum(sorted_out[1:] != sorted_out[:-1], axis=0)
    product = 2.0 * inside * (n - inside)
    mean, variance = 1.0 + product / n, product * (product - n) / (n**2 * max(n - 1.0, 1.0))
    return bool(np.min(runs) < mean - _TOGETHER * np.sqrt(max(variance, 0.0)))
