"""Normal equations of a fit with very many columns, by blocks of the campaign, so that the columns never are in memory.

The fit is linearised at its solution and its prior is Gaussian, so J'J and J'y of each block are all that is needed:

    x = (N + P)^-1 (g + P mean),    N = sum of J'J over the blocks, P = s^2 / size^2 on the diagonal.

Sizes that the readings shall say themselves, one for a band of columns, are those of the largest marginal likelihood;
with gamma_i = 1 - P_i C_ii, C = (N + P)^-1, how much the readings determine of parameter i, they are fixed points of

    size^2 = sum x_i^2 / sum gamma_i,    s^2 = |y - J x|^2 / (rows - sum gamma_i).

What a fit without block B leaves there needs no more: |y_B|^2 - 2 x'g_B + x'N_B x, x from the other blocks.
Source: MacKay 1992 (evidence).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs

from calib.array import Array
from calib.data.conditions import Conditions
from calib.fit.least_squares import LEAST_NOISE
from calib.fit.readings import Readings, linearised
from calib.model.model import RobotModel

BLOCKS = 8
_LEAST_SIZE, _LARGEST_SIZE = 1e-8, 1e-3  # rad: 0.0006 mdeg, and 57 mdeg, more than any gear errs
_LEAST_SHARE = 1e-3  # of a parameter that a band must determine before its size is taken from it


def blocks_of(conditions: Conditions) -> NDArray[np.int64]:
    """(n,) block of every reading: stretches of equal length, of each series, in the order in which its poses were
    first visited. Poses are whole: a curve of many orders learns by heart what a pose has of its own."""
    block = np.zeros(len(conditions), dtype=np.int64)
    for s in np.unique(conditions.series):
        rows = np.flatnonzero(conditions.series == s)
        order, pose = conditions.order[rows], conditions.pose[rows]
        first = np.full(int(pose.max()) + 1, np.inf)
        np.minimum.at(first, pose, order)
        stretch = np.argsort(np.lexsort((order, first[pose]))) * BLOCKS // len(rows)
        of_pose = np.full(len(first), BLOCKS)
        np.minimum.at(of_pose, pose, stretch)
        block[rows] = of_pose[pose]
    return block


@dataclass(frozen=True)
class Posterior:
    """Estimate (a,), covariance (a, a) for unit noise, variance of the noise, prior variances (a,), determined (a,),
    prior means (a,)."""

    estimate: Array
    covariance: Array
    noise: float
    variance: Array
    determined: Array
    mean: Array


@dataclass(frozen=True)
class Normal:
    """J'J (B, a, a) and J'y (B, a) of every block, |y|^2 (B,), and the number of rows; y counts from estimate zero."""

    gram: Array
    right: Array
    square: Array
    rows: int

    @classmethod
    def of(cls, model: RobotModel, readings: Readings, estimate: Array, active: NDArray[np.bool_]) -> Normal:
        """The normal equations of a model linearised at an estimate (m,), over its active parameters (mask (m,))."""
        block, count = blocks_of(readings.conditions), int(active.sum())
        gram, right, square = np.zeros((BLOCKS, count, count)), np.zeros((BLOCKS, count)), np.zeros(BLOCKS)
        for b in range(BLOCKS):
            for _, residual, by_row in linearised(
                model, readings.taken(np.flatnonzero(block == b)), estimate
            ):
                columns = by_row.T[active]
                y = residual.ravel() + estimate[active] @ columns
                gram[b] += columns @ columns.T
                right[b] += columns @ y
                square[b] += y @ y
        return cls(gram, right, square, readings.observed.count)

    def take(self, columns: NDArray[np.int64]) -> Normal:
        """The normal equations of some of the columns only."""
        return replace(self, gram=self.gram[:, columns[:, None], columns], right=self.right[:, columns])

    def posterior(
        self,
        prior: Array,
        band: NDArray[np.int64],
        measured: NDArray[np.bool_],
        rounds: int,
        mean: Array | None = None,
    ) -> Posterior:
        """The fit, its noise and the sizes of its bands by evidence.

        prior: (a,) variance, infinite where free; for columns of a band (band >= 0) it is the start. measured: priors
        that are measurements, which count beside the declared noise. mean: (a,) of the priors, None: zero.
        """
        gram, right, square = self.gram.sum(axis=0), self.right.sum(axis=0), float(self.square.sum())
        variance, banded = prior.copy(), band >= 0
        mean = np.zeros(len(prior)) if mean is None else mean
        noise = 1.0
        while True:
            penalty = np.where(measured, max(noise, 1.0), noise) / variance
            covariance = inverse(gram, penalty)
            estimate = covariance @ (right + penalty * mean)
            determined = 1.0 - penalty * np.diag(covariance)
            left = square - 2.0 * float(estimate @ right) + float(estimate @ gram @ estimate)
            noise = max(left / max(self.rows - float(determined.sum()), 1.0), LEAST_NOISE**2)
            rounds -= 1
            if rounds <= 0:
                return Posterior(estimate, covariance, noise, variance, determined, mean)
            energy = np.bincount(band[banded], estimate[banded] ** 2)
            freedom = np.bincount(band[banded], determined[banded])
            size = np.sqrt(energy / np.maximum(freedom, _LEAST_SHARE))
            variance[banded] = np.clip(size, _LEAST_SIZE, _LARGEST_SIZE)[band[banded]] ** 2

    def left_out(self, posterior: Posterior, groups: list[NDArray[np.int64]]) -> Array:
        """(groups, B) by how much the squared error on each left-out block falls because the model has a group of
        columns, at the priors of `posterior`; negative where the group does harm to readings it was not fitted to."""
        gram, right = self.gram.sum(axis=0), self.right.sum(axis=0)
        penalty = posterior.noise / posterior.variance
        gains = np.zeros((len(groups), BLOCKS))
        for b in range(BLOCKS):
            covariance = inverse(gram - self.gram[b], penalty)
            estimate = covariance @ (right - self.right[b] + penalty * posterior.mean)
            whole = self._error(b, estimate)
            gains[:, b] = [self._error(b, _without(estimate, covariance, group)) - whole for group in groups]
        return gains

    def _error(self, block: int, estimate: Array) -> float:
        moved = self.gram[block] @ estimate
        return float(self.square[block] - 2.0 * estimate @ self.right[block] + estimate @ moved)


def _without(estimate: Array, covariance: Array, columns: NDArray[np.int64]) -> Array:
    """The estimate (a,) under the condition that some columns' parameters are zero."""
    within = covariance[np.ix_(columns, columns)]
    out = estimate - covariance[:, columns] @ np.linalg.solve(within, estimate[columns])
    out[columns] = 0.0
    return out


def inverse(gram: Array, penalty: Array) -> Array:
    """(a, a) inverse of J'J + diag(penalty), scaled to a unit diagonal meanwhile.

    Raises LinAlgError where readings and priors together leave a direction open.
    """
    size = np.sqrt(np.diag(gram) + penalty)
    scaled = gram / np.outer(size, size)
    np.fill_diagonal(scaled, 1.0)
    factor, invert = get_lapack_funcs(("potrf", "potri"), (scaled,))
    lower, wrong = factor(scaled, lower=1)
    if wrong:
        raise np.linalg.LinAlgError("the normal equations are singular")
    half, _ = invert(lower, lower=1)
    whole: Array = half + half.T
    np.fill_diagonal(whole, np.diag(half))
    return whole / np.outer(size, size)
