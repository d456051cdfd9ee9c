"""Gauss-Newton on the exact chain, with priors, weights a reading and named rank deficiency.

minimise  sum_i w_i |W_i (measured_i - predicted_i(x))|^2  +  s^2 sum_j (x_j / size_j)^2

s is the noise scale, at least 1: where the readings are noisier than declared, the prior is as much weaker
relative to the declared noise as they are. Steps are solved by QR on scaled columns; a step that does not
lower the cost is halved.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from calib.kinematics import Array, Frames
from calib.model import Design
from calib.observations import Points

MAX_ITERATIONS = 30
_CONVERGED = 1e-6  # root mean square change of the prediction, relative to the noise
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
    iterations: int
    converged: bool


def jacobian(design: Design, points: Points, frames: Frames) -> Array:
    """(rows, m) whitened derivative of the prediction."""
    return design.columns(lambda slot: points.column(frames, slot), points.rows)


def find_dependent(design: Design, points: Points, estimate: Array) -> tuple[NDArray[np.bool_], tuple[Dropped, ...]]:
    """Which parameters the readings determine: mask (m,) and the dropped ones by name.

    A column that those before it explain to one part in 10^7 is dropped: the first of a confounded group stays.
    """
    names = [p.name for p in design.model.parameters]
    columns = jacobian(design, points, design.frames(estimate))
    scale = np.linalg.norm(columns, axis=0)
    seen = scale > 1e-9 * (np.max(scale) if len(scale) else 1.0)
    triangle = np.linalg.qr(columns / np.where(seen, scale, 1.0), mode="r")
    kept: list[int] = []
    dropped = []
    for j, name in enumerate(names):
        if not seen[j]:
            dropped.append(Dropped(name, ()))
            continue
        column = triangle[:, j]
        basis = triangle[:, kept]
        share, *_ = np.linalg.lstsq(basis, column, rcond=None)
        if kept and np.linalg.norm(column - basis @ share) < _DEPENDENT:
            weight = np.abs(share)
            with_ = [names[kept[i]] for i in np.argsort(-weight) if weight[i] > 0.05 * weight.max()]
            dropped.append(Dropped(name, tuple(with_[:6])))
        else:
            kept.append(j)
    active = np.zeros(len(names), dtype=bool)
    active[kept] = True
    return active, tuple(dropped)


def solve(
    design: Design,
    points: Points,
    start: Array,
    active: NDArray[np.bool_],
    weights: Array | None = None,
    scale: float = 1.0,
    max_iterations: int = MAX_ITERATIONS,
) -> Solution:
    """Minimise from `start` (m,) over the `active` parameters.

    weights: (n,) per reading; scale: noise scale s for the prior. A solution that did not converge says so.
    """
    root = np.ones(len(design.conditions)) if weights is None else np.sqrt(weights)
    prior = np.where(active, max(scale, 1.0) / design.model.prior_std, 0.0)[active]
    estimate = start.copy()
    frames = design.frames(estimate)
    residual = points.residual(frames)
    cost = _cost(residual, root, prior, estimate[active])
    iterations, converged = 0, False
    small = _CONVERGED * max(scale, 1.0)
    triangle, size = np.eye(int(active.sum())), np.ones(int(active.sum()))
    while iterations < max_iterations and not converged:
        iterations += 1
        columns = jacobian(design, points, frames)[:, active] * np.tile(root, len(residual))[:, None]
        size = np.sqrt(np.sum(columns**2, axis=0) + prior**2)
        system = np.vstack([columns / size, np.diag(prior / size)])
        right = np.concatenate([(residual * root).ravel(), -prior * estimate[active]])
        whole = np.linalg.qr(np.column_stack([system, right]), mode="r")
        triangle = whole[: len(size), : len(size)]
        scaled = solve_triangular(triangle, whole[: len(size), -1])
        change = float(np.linalg.norm(triangle @ scaled)) / np.sqrt(max(residual.size, 1))
        step = scaled / size
        for _ in range(12):
            trial = estimate.copy()
            trial[active] += step
            frames_there = design.frames(trial)
            residual_there = points.residual(frames_there)
            cost_there = _cost(residual_there, root, prior, trial[active])
            if cost_there <= cost * (1.0 + 1e-12) or change < small:
                break
            step = step / 2.0
        else:
            break
        estimate, frames, residual, cost = trial, frames_there, residual_there, cost_there
        converged = change < small
    inverse = solve_triangular(triangle, np.eye(len(size))) / size[:, None]
    covariance = np.zeros((len(active), len(active)))
    covariance[np.ix_(active, active)] = inverse @ inverse.T
    return Solution(estimate, covariance, residual, frames, iterations, converged)


def _cost(residual: Array, root: Array, prior: Array, estimate: Array) -> float:
    return float(np.sum((residual * root) ** 2) + np.sum((prior * estimate) ** 2))
