"""Multi-output least-squares support vector regression (MLS-SVR), Xu et al. 2013, used by Khanesar et al. 2022.

m outputs y of n samples on features phi share a vector w0 and differ by v_i:

    minimise  w0'w0 / 2 + lambda/(2m) sum v_i'v_i + gamma/2 sum xi'xi,   y_i = phi'(w0 + v_i) + b_i + xi_i

The six steps of the paper solve H eta = P, H nu = y with H = 1_{mxm} (x) K + I/gamma + (m/lambda) I_m (x) K, then
S = P'eta, b = S^-1 eta'y, alpha = nu - eta b, w0 = Phi sum alpha_i, v_i = (m/lambda) Phi alpha_i. H has m n rows and
its Cholesky fails from gamma = 1e12 on. The same solution in three steps, stable at any gamma:

1. turn the outputs by an orthogonal Q whose first column is (1, ..., 1)/sqrt(m). 1_{mxm} becomes diagonal, so every
   turned output is a problem of its own with the kernel s_j K: s_1 = m + m/lambda, the others m/lambda;
2. the offset b makes each problem one on samples whose mean is taken off, in the features as in the output;
3. with the centred features U diag(k) V', the weights of turned output z are V diag(s k / (s k^2 + 1/gamma)) U'z.

A Gaussian kernel has no features that can be written down; its columns, one a sample, take their place, and U/k that
of V: the kernel at new features times U/k are their coordinates.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array

_TINY = 1e-300


@dataclass(frozen=True)
class Components:
    """Orthogonal coordinates of n samples: rows, their mean (b,) taken off, times `into` (b, r) are `left` (n, r) with
    the columns scaled by `sizes` (r,). Directions that are rounding only are left out."""

    mean: Array
    into: Array
    left: Array
    sizes: Array


@dataclass(frozen=True)
class Linear:
    """Features as they are: a ridge regression with two penalties."""

    def rows(self, new: Array, _: Array) -> Array:
        """The rows that the weights act on at new features (k, p): the features."""
        return new

    def components(self, rows: Array) -> Components:
        """Coordinates of training features (n, p)."""
        mean = rows.mean(axis=0)
        left, sizes, into = np.linalg.svd(rows - mean, full_matrices=False)
        known = sizes > 1e-13 * max(float(sizes.max(initial=0.0)), _TINY)
        return Components(mean, into[known].T, left[:, known], sizes[known])


@dataclass(frozen=True)
class Gaussian:
    """Radial basis functions exp(-|phi - phi'|^2 / (2 width^2)) of the features."""

    width: float

    def rows(self, new: Array, old: Array) -> Array:
        """The rows that the weights act on at new features (k, p): the kernel (k, n) with the training features
        (n, p)."""
        squared = (new**2).sum(axis=1)[:, None] + (old**2).sum(axis=1) - 2.0 * new @ old.T
        return np.exp(-np.maximum(squared, 0.0) / (2.0 * self.width**2))

    def components(self, rows: Array) -> Components:
        """Coordinates of training samples, from their kernel (n, n)."""
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

    features (n, p): those it was trained on; mean (b,) and weights (b, m) with b = p of a linear kernel, n of a
    Gaussian one; offset (m,) mean of the outputs; share: the paper's lambda, small where outputs have little in common.
    """

    kernel: Kernel
    gamma: float
    share: float
    features: Array
    mean: Array
    weights: Array
    offset: Array

    def predict(self, features: Array) -> Array:
        """(k, m) outputs at features (k, p)."""
        return (self.kernel.rows(features, self.features) - self.mean) @ self.weights + self.offset


def turned(outputs: int) -> Array:
    """(m, m) orthogonal, its first column (1, ..., 1)/sqrt(m): step 1."""
    first = np.column_stack([np.ones(outputs), np.eye(outputs)[:, : outputs - 1]])
    return np.linalg.qr(first)[0]


def scales(share: float, outputs: int) -> Array:
    """(m,) s: how much of the kernel every turned output has."""
    return outputs / share + np.where(np.arange(outputs) == 0, float(outputs), 0.0)


def fit(features: Array, outputs: Array, kernel: Kernel, gamma: float, share: float) -> MlsSvr:
    """Train on features (n, p) and outputs (n, m). gamma: weight of the misfit; share: the paper's lambda.

    Raises ValueError for a gamma or share that is not positive, or fewer than two samples.
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
