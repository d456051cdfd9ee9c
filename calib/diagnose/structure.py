"""What is left: is it noise of the declared size, more noise, or structure, and where does the structure live?

Scale-free: smooth functions of each joint angle, of time and of the place in the workspace, times the three axes
of the world, are fitted to the residual, and an F test asks whether they explain more than chance (all tests
counted). The functions are general on purpose: they claim no cause, they only say where one is missing.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from calib.diagnose.space import Space
from calib.kinematics import Array

ALARM = 0.001  # chance that a data set without structure raises an alarm, over all places
NOISY = 0.001  # chance that noise of the declared size fails the chi-square


@dataclass(frozen=True)
class Structure:
    """Left-over structure: where it lives, how sure, and what share of the left-over variance it explains."""

    where: str
    p_value: float
    explained_variance: float


def left_over(space: Space) -> list[Structure]:
    """Places where structure is left, most certain first; empty where none passes."""
    conditions = space.fitted.readings.conditions
    places: dict[str, Array] = {
        f"joint {k + 1} angle": _waves(angle, 4)
        for k, angle in enumerate(conditions.joints.T)
        if np.ptp(angle) > 0
    }
    if np.all(np.isfinite(conditions.time)) and np.ptp(conditions.time) > 0.0:
        places["time"] = _powers(conditions.order, 5)
    # Predicted places: a measured one contains the residual, and would explain it by itself.
    predicted = np.broadcast_to(space.frames.p, (3, len(conditions))).T
    places["region of the workspace"] = _quadratic(predicted)
    places["tool target"] = np.eye(len(conditions.target_names))[conditions.target]
    found = []
    for where, functions in places.items():
        chance, share = _test(space, functions)
        chance = min(1.0, chance * len(places))
        if chance < ALARM:
            found.append(Structure(where, chance, share))
    return sorted(found, key=lambda s: (s.p_value, -s.explained_variance))


def p_lack_of_fit(space: Space) -> float:
    """Chance that noise of the declared size leaves this much."""
    return float(stats.chi2.sf(float(np.sum(space.residual**2)), max(space.freedom, 1)))


def _test(space: Space, functions: Array) -> tuple[float, float]:
    """F test of functions (n, f) times the three axes of the world: p-value and explained share."""
    n = len(functions)
    axes = np.broadcast_to(np.eye(3)[:, :, None], (3, 3, n))
    # columns: what a reading shows of a unit step of the tool point along each axis, modulated by each function
    shown = space.fitted.readings.observed.displaced(space.frames, axes)
    columns = np.einsum("akn,nf->knaf", shown, functions).reshape(space.size, -1)
    columns = columns - space.basis_of_readings @ (space.basis_of_readings.T @ columns)
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-3 * max(float(s[0]), 1e-300)]
    gain = float(np.sum((u.T @ space.residual.ravel()) ** 2))
    count, left = u.shape[1], space.freedom - u.shape[1]
    if count == 0 or left <= 0:
        return 1.0, 0.0
    ratio = (gain / count) / (max(space.rss - gain, 1e-300) / left)
    return float(stats.f.sf(ratio, count, left)), gain / space.rss


def _waves(angle: Array, orders: int) -> Array:
    """cos and sin over the measured range, 1 to `orders` half waves, (n, 2 orders)."""
    phase = (angle - angle.min()) / np.ptp(angle) * np.pi
    return np.column_stack([f(k * phase) for k in range(1, orders + 1) for f in (np.cos, np.sin)])


def _powers(order: Array, degree: int) -> Array:
    """Legendre polynomials of the order of the readings, (n, degree)."""
    x = 2.0 * (order - order.min()) / np.ptp(order) - 1.0
    return np.polynomial.legendre.legvander(x, degree)[:, 1:]


def _quadratic(point: Array) -> Array:
    """Linear and quadratic functions of the place, (n, 9)."""
    x = (point - point.mean(axis=0)) / np.maximum(point.std(axis=0), 1e-9)
    pairs = [(i, j) for i in range(3) for j in range(i, 3)]
    return np.column_stack([x, *(x[:, i] * x[:, j] for i, j in pairs)])
