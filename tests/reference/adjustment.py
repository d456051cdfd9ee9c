"""Weighted least squares to convergence: Gauss-Newton by QR in fifty digits.

Every derivative is a central difference. The cost is

    sum over the readings of |L^-1 (measured - predicted(x))|^2,  L L' the declared covariance, no prior.

A step of less than 10^-20 standard errors ends it. Standard errors are those of the declared noise: the roots of
the diagonal of (J'J)^-1 at the minimum, J the whitened Jacobian there.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from decimal import Decimal

import numpy as np

from tests.reference.decimals import Matrix, factor, identity, norm, precise, solve_lower
from tests.reference.problem import Problem, Reading, residual
from tests.reference.weights import STEP, whitener

CONVERGED = Decimal("1e-20")  # length of the last step in standard errors
MAX_ITERATIONS = 30


@dataclass(frozen=True)
class Certified:
    """Minimum of a problem: parameters by name, in their units.

    `condition` is that of the Jacobian with columns of equal length.
    """

    estimate: Mapping[str, Decimal]
    standard_error: Mapping[str, Decimal]
    sum_of_squares: Decimal
    degrees_of_freedom: int
    condition: float
    iterations: int


@precise
def adjust(problem: Problem, start: Mapping[str, Decimal], converged: Decimal = CONVERGED) -> Certified:
    """Estimate the parameters of a problem.

    Raises
    ------
    ArithmeticError
        Gauss-Newton does not converge.
    """
    values = dict(start)
    names = [p.name for p in problem.parameters]
    lowers = [whitener(problem, reading) for reading in problem.readings]
    for iteration in range(1, MAX_ITERATIONS + 1):
        parts = [_linearised(problem, *pair, values) for pair in zip(problem.readings, lowers, strict=True)]
        right = np.concatenate([part[0] for part in parts])
        columns = np.concatenate([part[1] for part in parts])
        size = np.array([norm(columns[:, j]) for j in range(len(names))])
        q, r = factor(columns / size)
        projection = q.T @ right
        # r step = projection, from the last row up: the transposed system turned upside down is lower triangular
        step = solve_lower(r[::-1, ::-1], projection[::-1])[::-1] / size
        values = {name: values[name] + change for name, change in zip(names, step, strict=True)}
        if norm(projection) < converged:
            inverse = solve_lower(r.T, identity(len(names))).T
            errors = [norm(row) / s for row, s in zip(inverse, size, strict=True)]
            singular = np.linalg.svd(r.astype(np.float64), compute_uv=False)
            return Certified(
                values,
                dict(zip(names, errors, strict=True)),
                norm(right) ** 2,
                len(right) - len(names),
                float(singular[0] / singular[-1]),
                iteration,
            )
    raise ArithmeticError(f"no convergence in {MAX_ITERATIONS} iterations")


def _linearised(
    problem: Problem, reading: Reading, lower: Matrix, values: Mapping[str, Decimal]
) -> tuple[Matrix, Matrix]:
    """Whitened residual (k,) of a reading, and the derivative (k, m) of its prediction."""
    columns = []
    for p in problem.parameters:
        if p.series not in ("", reading.series) or p.target not in ("", reading.target):
            columns.append(0 * lower[:, 0])
            continue
        ends = [
            residual(problem, reading, {**values, p.name: values[p.name] + side}) for side in (STEP, -STEP)
        ]
        columns.append((ends[1] - ends[0]) / (2 * STEP))
    return solve_lower(lower, residual(problem, reading, values)), solve_lower(lower, np.array(columns).T)
