"""Multi-output least-squares support vector regression (MLS-SVR), with its cross-validation.

Sources: Xu et al. 2013; used by Khanesar et al. 2022.

m outputs y of n samples on features phi share a vector w0 and differ by v_i:

    minimise  w0'w0 / 2 + lambda/(2m) sum v_i'v_i + gamma/2 sum xi'xi,   y_i = phi'(w0 + v_i) + b_i + xi_i

The six steps of the paper solve

    H eta = P, H nu = y   with   H = 1_{mxm} (x) K + I/gamma + (m/lambda) I_m (x) K

and then

    S = P'eta, b = S^-1 eta'y, alpha = nu - eta b, w0 = Phi sum alpha_i, v_i = (m/lambda) Phi alpha_i

H has m n rows, and its Cholesky factorisation fails from gamma = 1e12 on. Three steps give the same solution and
are stable at any gamma:

1. The outputs are rotated by an orthogonal Q whose first column is (1, ..., 1)/sqrt(m). This makes 1_{mxm} diagonal.
   Each rotated output is then a separate problem with the kernel s_j K, where s_1 = m + m/lambda and the others are
   m/lambda.
2. The offset b is removed by subtracting the mean of the samples from both the features and the output.
3. With the centred features U diag(k) V', the weights of a rotated output z are V diag(s k / (s k^2 + 1/gamma)) U'z.

A Gaussian kernel has no features that can be written down. Its columns, one per sample, take their place, and U/k
takes the place of V. The coordinates of new features are their kernel times U/k.

The constants gamma and lambda and the width of the kernel are chosen by cross-validation over groups of samples.
Samples of one waypoint differ only by noise. Leaving them out one by one would be optimistic, so whole waypoints
are left out.

Each rotated output has one ridge, rho_j = 1 / (gamma s_j). The first has rho_1, and all others have rho_2 = (1 +
lambda) rho_1. The rotation preserves squares. The error of a pair (gamma, lambda) is therefore the error of the
first output at rho_1 plus that of the others at rho_2, and one scan over rho serves all pairs.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

_TINY = 1e-300


@dataclass(frozen=True)
class Components:
    """Orthogonal coordinates of n samples.

    The rows minus their `mean` (b,), times `into` (b, r), are `left` (n, r) with its columns scaled by `sizes`
    (r,). Directions that consist of rounding errors only are left out.
    """

    mean: Array
    into: Array
    left: Array
    sizes: Array


@dataclass(frozen=True)
class Linear:
    """Features as they are: a ridge regression with two penalties."""

    def rows(self, new: Array, _: Array) -> Array:
        """Return the rows at new features (k, p) that the weights act on: the features themselves."""
        return new

    def components(self, rows: Array) -> Components:
        """Compute the coordinates of training features (n, p)."""
        mean = rows.mean(axis=0)
        left, sizes, into = np.linalg.svd(rows - mean, full_matrices=False)
        known = sizes > 1e-13 * max(float(sizes.max(initial=0.0)), _TINY)
        return Components(mean, into[known].T, left[:, known], sizes[known])


@dataclass(frozen=True)
class Gaussian:
    """Radial basis functions exp(-|phi - phi'|^2 / (2 width^2)) of the features."""

    width: float

    def rows(self, new: Array, old: Array) -> Array:
        """Return the kernel (k, n) of new features (k, p) with the training features (n, p).

        The weights act on these rows.
        """
        squared = (new**2).sum(axis=1)[:, None] + (old**2).sum(axis=1) - 2.0 * new @ old.T
        return np.exp(-np.maximum(squared, 0.0) / (2.0 * self.width**2))

    def components(self, rows: Array) -> Components:
        """Compute the coordinates of training samples from their kernel (n, n)."""
        mean = rows.mean(axis=0)
        centred = rows - mean - mean[:, None] + mean.mean()
        values, vectors = np.linalg.eigh(0.5 * (centred + centred.T))
        # An eigenvalue is known to the rounding of the largest, its root, which is the size here, to the root of that.
        known = values > len(rows) * np.finfo(float).eps * max(float(values.max(initial=0.0)), _TINY)
        sizes, left = np.sqrt(values[known]), vectors[:, known]
        return Components(mean, left / sizes, left, sizes)


Kernel = Linear | Gaussian


@dataclass(frozen=True)
class MlsSvr:
    """A trained regression: (kernel.rows(phi, features) - mean) @ weights + offset.

    Attributes
    ----------
    share : float
        The lambda of the paper; small if the outputs have little in common.
    features : array of shape (n, p)
        Features of the training samples.
    mean : array of shape (b,)
        Mean of the rows of the kernel; b is p for a linear kernel and n for a Gaussian one.
    weights : array of shape (b, m)
        Weights of the outputs.
    offset : array of shape (m,)
        Mean of the outputs.
    """

    kernel: Kernel
    gamma: float
    share: float
    features: Array
    mean: Array
    weights: Array
    offset: Array

    def predict(self, features: Array) -> Array:
        """Predict the outputs (k, m) at features (k, p)."""
        return (self.kernel.rows(features, self.features) - self.mean) @ self.weights + self.offset


def turned(outputs: int) -> Array:
    """Return the orthogonal matrix (m, m) of step 1; its first column is (1, ..., 1)/sqrt(m)."""
    first = np.column_stack([np.ones(outputs), np.eye(outputs)[:, : outputs - 1]])
    return np.linalg.qr(first)[0]


def scales(share: float, outputs: int) -> Array:
    """Return the scale s of the kernel for each rotated output, shape (m,)."""
    return outputs / share + np.where(np.arange(outputs) == 0, float(outputs), 0.0)


def fit(features: Array, outputs: Array, kernel: Kernel, gamma: float, share: float) -> MlsSvr:
    """Train on features (n, p) and outputs (n, m).

    Parameters
    ----------
    gamma : float
        Weight of the misfit.
    share : float
        The lambda of the paper.

    Raises
    ------
    ValueError
        `gamma` or `share` is not positive, or there are fewer than two samples.
    """
    if not (gamma > 0.0 and share > 0.0):
        raise ValueError("gamma and lambda are above zero")
    if len(features) < 2:
        raise ValueError("a regression needs two samples or more")
    count = outputs.shape[1]
    found = kernel.components(kernel.rows(features, features))
    turn, scale, size = turned(count), scales(share, count), found.sizes[:, None]
    offset = outputs.mean(axis=0)
    projected = found.left.T @ ((outputs - offset) @ turn)
    # Written so that neither a large gamma nor a small share overflows.
    weights = found.into @ (size * projected / (size**2 + 1.0 / (gamma * scale))) @ turn.T
    return MlsSvr(kernel, gamma, share, features, found.mean, weights, offset)


FOLDS = 5
_SEED = 1
_RIDGES = np.logspace(-14.0, 4.0, 91)  # of the sum of squares of the centred features
_LEAST_SHARE = 1e-2
_SURE = 2.0  # standard errors by which a regression must be better than predicting zero
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class Tuning:
    """Kernel and constants chosen by cross-validation.

    Attributes
    ----------
    rms : float
        RMS error on the groups left out; the errors of all outputs of a sample are combined.
    rms_of_nothing : float
        The same if zero is predicted.
    sure : bool
        Whether the gain over predicting zero exceeds twice its standard error over the groups.
    """

    kernel: Kernel
    gamma: float
    share: float
    rms: float
    rms_of_nothing: float
    sure: bool

    def fit(self, features: Array, outputs: Array) -> MlsSvr:
        """Train the chosen regression on features (n, p) and outputs (n, m)."""
        return fit(features, outputs, self.kernel, self.gamma, self.share)


def folds_of(group: NDArray[np.int64]) -> list[Mask]:
    """Return masks (n,) of the samples to leave out; whole groups are drawn at random.

    Raises
    ------
    ValueError
        There are fewer than two groups.
    """
    kinds, number = np.unique(group, return_inverse=True)
    if len(kinds) < 2:
        raise ValueError("one group of samples cannot be left out and kept")
    draw = np.random.default_rng(_SEED).permutation(len(kinds))
    count = min(FOLDS, len(kinds))
    return [draw[number] % count == k for k in range(count)]


def choose(
    features: Array, outputs: Array, group: NDArray[np.int64], kernels: Sequence[Kernel] = (Linear(),)
) -> Tuning:
    """Choose the best kernel, gamma and lambda by leaving out groups (n,) of samples.

    The features have the shape (n, p), and the outputs (n, m).
    """
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
    """Return Gaussian kernels of several widths.

    The widths range from 0.3 to 30 times the median distance between the features (n, p).
    """
    sample = features[:: max(1, len(features) // 300)]
    apart = np.linalg.norm(sample[:, None] - sample[None], axis=2)
    middle = float(np.median(apart[np.triu_indices(len(sample), 1)])) if len(sample) > 1 else 1.0
    return tuple(Gaussian(max(middle, 1e-6) * step) for step in (0.3, 1.0, 3.0, 10.0, 30.0))


def _of_kernel(
    features: Array, outputs: Array, folds: Sequence[Mask], kernel: Kernel
) -> tuple[float, Kernel, float, float]:
    """Return the least sum of squared errors on the left-out samples, with its constants.

    These are the kernel, gamma and lambda that give this sum.
    """
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
    """Sum the squared errors of the rotated outputs (n, m) on the held samples.

    The result has one column per ridge, shape (m, r).
    """
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
