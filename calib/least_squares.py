"""Gauss-Newton on the exact chain, with priors, weights a reading and named rank deficiency.

minimise  sum_i w_i |W_i (measured_i - predicted_i(x))|^2  +  s^2 sum_j (x_j / size_j)^2

s is the noise scale: where the readings are noisier than declared the prior counts for more against them, where
they are better than declared for less, so that readings without noise come back as they are (a prior that is a
measurement, of a base target, keeps its worth beside the declared noise). Steps are solved on scaled columns; a step
that does not lower the cost is halved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from calib.kinematics import Array, Frames
from calib.model import Design
from calib.observations import Observations
from calib.units import to_internal

MAX_ITERATIONS = 50
CONVERGED = 0.02  # length of a step in standard errors of the estimate
LEAST_NOISE = 0.01  # of the declared noise: below it the prior weakens no further
_MOVES_NOTHING = 1e-6  # whitened displacement, over all readings, for a parameter of its usual size
_DEPENDENT = 1e-7  # share of a column left when those before it are projected out


@dataclass(frozen=True)
class Dropped:
    """A parameter that the readings cannot determine, and those with which it is confounded."""

    name: str
    confounded_with: tuple[str, ...]


@dataclass(frozen=True)
class Solution:
    """Where Gauss-Newton ended. Arrays of m parameters; `covariance` for noise as declared (scale 1)."""

    estimate: Array
    covariance: Array
    residual: Array  # (k, n) whitened, unweighted
    frames: Frames
    columns: Array  # (k n, active) whitened, weighted Jacobian of the last step
    prior: Array  # (m,) weight of the prior of every parameter, 0 where there is none
    iterations: int
    converged: bool

    def standardised(self) -> Array:
        """(n,) length of every residual for noise as declared, in the metric of its own spread, I - H.

        H is the reading's block of the hat matrix: a fit pulls itself to its readings, most to those that stand
        alone. Each is chi distributed with as many degrees of freedom as the reading has rows.
        """
        k, n = self.residual.shape
        live = np.diag(self.covariance) > 0.0
        lower = np.linalg.cholesky(self.covariance[np.ix_(live, live)])
        hat = (self.columns @ lower).reshape(k, n, -1)
        left = np.eye(k) - np.einsum("ina,jna->nij", hat, hat, optimize=True)
        solved = np.linalg.solve(left, self.residual.T[:, :, None])[:, :, 0]
        return np.sqrt(np.maximum(np.sum(self.residual.T * solved, axis=1), 0.0))


def jacobian(design: Design, observed: Observations, frames: Frames) -> Array:
    """(k n, m) whitened derivative of the prediction."""
    return design.columns(observed.columns(frames, design.slots))


def triangular_factor(matrix: Array) -> Array:
    """(m, m) R of matrix (rows, m) = QR, by Householder reflections: safe for dependent columns."""
    return np.asarray(np.linalg.qr(matrix, mode="r"), dtype=np.float64)


def orthonormal(matrix: Array) -> tuple[Array, Array]:
    """Q (rows, m) and R (m, m) of a tall matrix, columns of about equal length.

    Cholesky of the Gram matrix, twice: as accurate as Householder up to a condition number of 10^7 and several
    times faster, since all work is matrix products. Beyond it, Householder. Source: Yamamoto et al. 2015.
    """
    try:
        first = np.linalg.cholesky(matrix.T @ matrix).T
        q = matrix @ np.linalg.inv(first)
        second = np.linalg.cholesky(q.T @ q).T
    except np.linalg.LinAlgError:
        q, r = np.linalg.qr(matrix)
        return q, r
    return q @ np.linalg.inv(second), second @ first


def _normal_factor(gram: Array, columns: Array, prior: Array, size: Array) -> Array:
    """(m, m) R with R'R = gram, scaled. An error in R only slows Gauss-Newton, which looks at the true residual.

    Where rounding makes gram indefinite: by reflections on the columns and priors it is made of, scaled by `size`.
    """
    try:
        return np.asarray(np.linalg.cholesky(gram).T, dtype=np.float64)
    except np.linalg.LinAlgError:
        return triangular_factor(np.vstack([columns / size, np.diag(prior / size)]))


def find_dependent(
    design: Design, observed: Observations, estimate: Array, settled: tuple[Dropped, ...] | None = None
) -> tuple[NDArray[np.bool_], tuple[Dropped, ...]]:
    """Which parameters the readings determine: mask (m,) and the dropped ones by name.

    A column that those before it explain to one part in 10^7 is dropped. Base and tool are
    looked at first: of a confounded group they stay, then whatever comes first in the model. Where a prior is a
    measurement (base targets known to 0.05 mm) it counts as one: the readings and it together determine them.
    With `settled`, what was decided for the base model stands, and only the parameters of effects are looked at.
    """
    parameters = design.model.parameters
    names = [p.name for p in parameters]
    of_base = [e.group == "base model" for e in design.model.effects for _ in e.parameters]
    before = {} if settled is None else {drop.name: drop for drop in settled}
    columns = jacobian(design, observed, design.frames(estimate, design.slots))
    known = np.diag(1.0 / design.model.prior_std)[design.model.measured]
    columns = np.vstack([columns, known])
    scale = np.linalg.norm(columns, axis=0)
    usual = np.array([to_internal(1.0 if p.size is None else p.size, p.unit) for p in parameters])
    seen = scale * usual > _MOVES_NOTHING
    # Parameters without a usual size (base, tool) first: among confounded ones those with a size give way, since
    # their nominal value is a good guess of them and a rough start is not.
    order = sorted(range(len(names)), key=lambda j: parameters[j].size is not None)
    settled_ones = {j for j in order if settled is not None and of_base[j] and names[j] not in before}
    dropped = {j: before[names[j]] for j in order if of_base[j] and names[j] in before}
    dropped |= {j: Dropped(names[j], ()) for j in order if not seen[j] and j not in dropped}
    kept = [j for j in order if j not in dropped]
    triangle = triangular_factor(columns[:, kept] / scale[kept])
    while (at := _first_dependent(triangle, [j in settled_ones for j in kept])) is not None:
        share = _shares(triangle[:at, :at], triangle[:at, at])
        weight = np.abs(share)
        heavy = [i for i in np.argsort(-weight)[:6] if weight[i] > 0.05 * weight.max()]
        dropped[kept[at]] = Dropped(names[kept[at]], tuple(names[kept[i]] for i in heavy))
        triangle = triangular_factor(np.delete(triangle, at, axis=1))
        del kept[at]
    active = np.zeros(len(names), dtype=bool)
    active[kept] = True
    return active, tuple(dropped[j] for j in order if j in dropped)


def _shares(before: Array, column: Array) -> Array:
    """(a,) how much of each column before explains a column; columns before may be dependent where they stand."""
    if np.all(np.abs(np.diag(before)) >= _DEPENDENT):
        return _back(before, column)
    return np.asarray(np.linalg.lstsq(before, column, rcond=None)[0], dtype=np.float64)


def _first_dependent(triangle: Array, stands: list[bool]) -> int | None:
    """The first column of R (m, m), columns of length 1, that those before it explain; None where there is none.

    What is left of a column stands on the diagonal. Columns that `stands` are never given up; behind one of them
    that is explained the diagonal no longer tells, so the others are then measured against it as it is.
    """
    left = np.zeros(triangle.shape[1])
    left[: min(triangle.shape)] = np.abs(np.diag(triangle))
    for j in np.flatnonzero(left < _DEPENDENT):
        if not stands[j]:
            return int(j)
    return None


def solve(
    design: Design,
    observed: Observations,
    start: Array,
    active: NDArray[np.bool_],
    weights: Array | None = None,
    scale: float = 1.0,
    max_iterations: int = MAX_ITERATIONS,
    tolerance: float = CONVERGED,
) -> Solution:
    """Minimise from `start` (m,) over the `active` parameters.

    weights: (n,) per reading; scale: noise scale s for the prior; tolerance: length of the last step, in standard
    errors of the estimate. A solution that did not converge says so.
    """
    root = None if weights is None else np.sqrt(weights)
    model = design.model
    weight = np.where(model.measured, max(scale, 1.0), max(scale, LEAST_NOISE))
    prior = np.where(active, weight / model.prior_std, 0.0)[active]
    estimate = start.copy()
    frames = design.frames(estimate, design.slots)
    residual = observed.residual(frames)
    cost = _cost(residual, root, prior, estimate[active])
    iterations, converged = 0, False
    small = tolerance * max(scale, 1.0)
    triangle, size = np.eye(int(active.sum())), np.ones(int(active.sum()))
    columns = np.zeros((residual.size, len(size)))
    while iterations < max_iterations and not converged:
        iterations += 1
        columns = jacobian(design, observed, frames)
        if not active.all():
            columns = columns[:, active]
        weighted = residual
        if root is not None:
            columns, weighted = columns * np.tile(root, len(residual))[:, None], residual * root
        gram = columns.T @ columns + np.diag(prior**2)
        size = np.sqrt(np.diag(gram))
        triangle = _normal_factor(gram / np.outer(size, size), columns, prior, size)
        right = (columns.T @ weighted.ravel() - prior**2 * estimate[active]) / size
        scaled = _back(triangle, _back(triangle, right, 1))
        change = float(np.linalg.norm(triangle @ scaled))
        step = scaled / size
        for _ in range(12):
            trial = estimate.copy()
            trial[active] += step
            frames_there = design.frames(trial, design.slots)
            residual_there = observed.residual(frames_there)
            cost_there = _cost(residual_there, root, prior, trial[active])
            # what a step so small promises drowns in the rounding of the cost, which then cannot judge it
            if cost_there <= cost * (1.0 + 1e-12) or change < small or change**2 < 1e-12 * cost:
                break
            step = step / 2.0
        else:
            break
        estimate, frames, residual, cost = trial, frames_there, residual_there, cost_there
        converged = bool(change < small)
    inverse = _back(triangle, np.eye(len(size))) / size[:, None]
    covariance = np.zeros((len(active), len(active)))
    covariance[np.ix_(active, active)] = inverse @ inverse.T
    weights_of_prior = np.zeros(len(active))
    weights_of_prior[active] = prior
    return Solution(estimate, covariance, residual, frames, columns, weights_of_prior, iterations, converged)


def _back(triangle: Array, right: Array, trans: int = 0) -> Array:
    """R x = right, or R' x = right: the numbers are known to be finite."""
    return solve_triangular(triangle, right, trans=trans, check_finite=False)


def _cost(residual: Array, root: Array | None, prior: Array, estimate: Array) -> float:
    weighted = residual if root is None else residual * root
    return float(np.sum(weighted**2) + np.sum((prior * estimate) ** 2))
