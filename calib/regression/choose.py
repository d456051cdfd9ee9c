"""gamma, lambda and the width of the kernel, by cross-validation over groups of samples.

Samples of one waypoint differ only by noise: leaving them out one by one would be optimistic, so whole waypoints are
left out. Of the turned outputs (see `mls_svr`) each has one ridge, rho_j = 1 / (gamma s_j): the
first one rho_1, all others rho_2 = (1 + lambda) rho_1. The turn keeps squares, so the error of a pair (gamma, lambda)
is the first output's error at rho_1 plus the others' at rho_2: one scan over rho serves all pairs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.regression.mls_svr import Gaussian, Kernel, Linear, MlsSvr, fit, turned

FOLDS = 5
_SEED = 1
_RIDGES = np.logspace(-14.0, 4.0, 91)  # of the sum of squares of the centred features
_LEAST_SHARE = 1e-2
_SURE = 2.0  # standard errors by which a regression must gain on predicting nothing

Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Tuning:
    """The choice of cross-validation.

    rms: of the outputs' errors (all of a sample together) on the groups left out; rms_of_nothing: of predicting
    zero; sure: whether the gain on it is more than twice its standard error over the groups.
    """

    kernel: Kernel
    gamma: float
    share: float
    rms: float
    rms_of_nothing: float
    sure: bool

    def fit(self, features: Array, outputs: Array) -> MlsSvr:
        """The regression with what was chosen, on features (n, p) and outputs (n, m)."""
        return fit(features, outputs, self.kernel, self.gamma, self.share)


def folds_of(group: NDArray[np.int64]) -> list[Mask]:
    """Masks (n,) of the samples to leave out, whole groups drawn at random. Raises ValueError for too few groups."""
    kinds, number = np.unique(group, return_inverse=True)
    if len(kinds) < 2:
        raise ValueError("one group of samples cannot be left out and kept")
    draw = np.random.default_rng(_SEED).permutation(len(kinds))
    count = min(FOLDS, len(kinds))
    return [draw[number] % count == k for k in range(count)]


def choose(
    features: Array, outputs: Array, group: NDArray[np.int64], kernels: Sequence[Kernel] = (Linear(),)
) -> Tuning:
    """The best kernel, gamma and lambda for features (n, p) and outputs (n, m) by groups (n,) left out."""
    folds = folds_of(group)
    _, kernel, gamma, share = min(
        (_of_kernel(features, outputs, folds, kernel) for kernel in kernels), key=lambda found: found[0]
    )
    missed = np.zeros(len(outputs))
    for held in folds:
        trained = fit(features[~held], outputs[~held], kernel, gamma, share)
        missed[held] = ((outputs[held] - trained.predict(features[held])) ** 2).sum(axis=1)
    nothing = (outputs**2).sum(axis=1)
    gains = np.bincount(np.unique(group, return_inverse=True)[1], weights=nothing - missed)
    spread = float(np.std(gains, ddof=1) * np.sqrt(len(gains)))
    return Tuning(
        kernel,
        gamma,
        share,
        float(np.sqrt(missed.mean())),
        float(np.sqrt(nothing.mean())),
        bool(gains.sum() > _SURE * spread),
    )


def widths(features: Array) -> tuple[Gaussian, ...]:
    """Gaussian kernels from a third of the median distance between features (n, p) to thirty times it."""
    sample = features[:: max(1, len(features) // 300)]
    apart = np.linalg.norm(sample[:, None] - sample[None], axis=2)
    middle = float(np.median(apart[np.triu_indices(len(sample), 1)])) if len(sample) > 1 else 1.0
    return tuple(Gaussian(max(middle, 1e-6) * step) for step in (0.3, 1.0, 3.0, 10.0, 30.0))


def _of_kernel(
    features: Array, outputs: Array, folds: Sequence[Mask], kernel: Kernel
) -> tuple[float, Kernel, float, float]:
    """Sum of squared errors on what is left out, and the kernel, gamma and lambda that make it least."""
    count = outputs.shape[1]
    rows = kernel.rows(features, features)
    # A Gaussian kernel is one at distance nought, and its trace the number of samples.
    total = len(rows) if isinstance(kernel, Gaussian) else float(((rows - rows.mean(axis=0)) ** 2).sum())
    ridges = _RIDGES * max(total, 1e-300)
    squares = np.zeros((count, len(ridges)))
    for held in folds:
        squares += _squares(rows, outputs @ turned(count), held, kernel, ridges)
    first, rest = squares[0], squares[1:].sum(axis=0)
    both = first[:, None] + rest[None, :]  # [rho_1, rho_2]
    both = np.where(ridges[None, :] >= (1.0 + _LEAST_SHARE) * ridges[:, None], both, np.inf)
    one, two = np.unravel_index(int(np.argmin(both)), both.shape)
    share = float(ridges[two] / ridges[one]) - 1.0
    return float(both[one, two]), kernel, share / (count * float(ridges[two])), share


def _squares(rows: Array, outputs: Array, held: Mask, kernel: Kernel, ridges: Array) -> Array:
    """(m, r) sums of squared errors of the turned outputs (n, m) on the held samples, for every ridge."""
    kept = ~held
    among = kept if isinstance(kernel, Gaussian) else np.ones(rows.shape[1], dtype=bool)
    found = kernel.components(rows[np.ix_(kept, among)])
    offset = outputs[kept].mean(axis=0)
    projected = found.left.T @ (outputs[kept] - offset)
    reach = (rows[np.ix_(held, among)] - found.mean) @ found.into
    shrunk = found.sizes[:, None] / (found.sizes[:, None] ** 2 + ridges)
    out = np.empty((outputs.shape[1], len(ridges)))
    for k in range(len(out)):
        missed = (outputs[held, k] - offset[k])[:, None] - reach @ (projected[:, k, None] * shrunk)
        out[k] = (missed**2).sum(axis=0)
    return out
