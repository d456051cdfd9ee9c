"""A patch: a smooth map of the residuals that no effect explains. It names no cause.

The residual vectors are fitted by kernel ridge regression on the cos and sin of each joint angle, so that a full
turn closes. The kernel is Gaussian on some landmark readings (Nystrom).

Width and ridge are chosen on left-out blocks of readings, never at random, because neighbours in a sweep would make
the error look too small. A patch is only useful if the error on those blocks becomes smaller. It says nothing about
poses unlike the measured ones, and no report calls it an effect.

Sources: Williams & Seeger 2001 (Nystrom); Khanesar et al. 2022 for regression on the residuals of a physical model.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.fit.held_out import errors_on
from calib.fit.identification import IdentificationFit
from calib.fit.statistics import ErrorStatistics, statistics_of

_LANDMARKS = 400
_BLOCKS = 5
_WIDTHS = (0.15, 0.3, 0.6, 1.2)
_RIDGES = (1e-3, 1e-2, 1e-1, 1.0, 10.0)
_WORTH = 0.97  # of the error on left-out blocks: a patch that gains less is not offered


@dataclass(frozen=True)
class Patch:
    """A smooth map of the residuals that no effect explains.

    `landmarks` (m, 2 N) are features and `weights` (m, 3) are in mm. The two errors on left-out blocks, without the
    patch and with it, are RMS values in mm.
    """

    landmarks: Array
    weights: Array
    width: float
    ridge: float
    block_rms_without: float
    block_rms_with: float

    def shift(self, conditions: Conditions) -> Array:
        """Return the shift to add to the prediction of the model, mm, shape (n, 3)."""
        return _kernel(_features(conditions), self.landmarks, self.width) @ self.weights

    @property
    def worth_it(self) -> bool:
        """Whether the errors on left-out blocks become clearly smaller."""
        return self.block_rms_with < _WORTH * self.block_rms_without


def patch_of(dataset: Dataset, found: IdentificationFit) -> Patch:
    """Fit the best patch for the points of a fit, chosen on left-out stretches of time.

    Use `worth_it` to decide whether the patch helps.

    Raises
    ------
    DataError
        No point was measured.
    """
    readings = found.readings
    pointed = dataset.pointed[readings.rows]
    if not pointed.any():
        raise DataError(
            "has no measured points: a residual map shifts points.",
            do="Leave the patch out.",
            file=dataset.path,
        )
    conditions = readings.conditions.take(pointed)
    left = dataset.points[readings.rows[pointed]] - found.predict(conditions)
    features = _features(conditions)
    n = len(features)
    rng = np.random.default_rng(0)
    landmarks = features[rng.permutation(n)[:_LANDMARKS]]
    rank = np.argsort(np.argsort(conditions.order))
    blocks = [rank * _BLOCKS // n == b for b in range(_BLOCKS)]
    best: tuple[float, float, float, Array] | None = None
    for width in _WIDTHS:
        kernel, gram = _kernel(features, landmarks, width), _kernel(landmarks, landmarks, width)
        # normal equations of every block, so that leaving one out is a difference
        squares = [kernel[b].T @ kernel[b] for b in blocks]
        moments = [kernel[b].T @ left[b] for b in blocks]
        whole, moment = np.sum(squares, axis=0), np.sum(moments, axis=0)
        for ridge in _RIDGES:
            square = 0.0
            for b, own, shared in zip(blocks, squares, moments, strict=True):
                weights = _solve(whole - own, moment - shared, gram, ridge)
                square += float(np.sum((left[b] - kernel[b] @ weights) ** 2))
            if best is None or square < best[0]:
                best = (square, width, ridge, _solve(whole, moment, gram, ridge))
    assert best is not None
    square, width, ridge, weights = best
    without = float(np.sqrt(np.sum(left**2) / n))
    return Patch(landmarks, weights, width, ridge, without, float(np.sqrt(square / n)))


def error_with_patch(dataset: Dataset, found: IdentificationFit, patch: Patch) -> ErrorStatistics | None:
    """Compute the position error on the measured validation points with the patch added."""
    rows = dataset.validation_rows & dataset.pointed
    conditions = dataset.conditions.take(rows)
    moved = found.predict(conditions) + patch.shift(conditions)
    return statistics_of(np.linalg.norm(moved - dataset.points[rows], axis=1))


def error_without_patch(dataset: Dataset, found: IdentificationFit) -> ErrorStatistics | None:
    """Compute the held-out error without the patch, including that of lengths."""
    rows = dataset.validation_rows & dataset.pointed
    return statistics_of(errors_on(dataset, rows, found.model, found.estimate))


def _features(conditions: Conditions) -> Array:
    """Return cos and sin of each joint, shape (n, 2 N)."""
    return np.hstack([np.cos(conditions.joints), np.sin(conditions.joints)])


def _kernel(x: Array, landmarks: Array, width: float) -> Array:
    """Return the Gaussian kernel exp(-|x - l|^2 / (2 w^2)), shape (n, m)."""
    square = np.sum(x**2, axis=1)[:, None] + np.sum(landmarks**2, axis=1) - 2.0 * x @ landmarks.T
    return np.exp(-np.maximum(square, 0.0) / (2.0 * width**2))


def _solve(square: Array, moment: Array, gram: Array, ridge: float) -> Array:
    """Return the weights a (m, 3) that minimise |left - K a|^2 + ridge a'G a.

    The arguments are K'K (m, m), K'left (m, 3) and G (m, m).
    """
    system = square + ridge * gram
    system += 1e-9 * np.trace(system) / len(system) * np.eye(len(system))
    return np.linalg.solve(system, moment)
