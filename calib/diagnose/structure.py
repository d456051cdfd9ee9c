"""What is left: is it noise of the declared size, more noise, or structure, and where does the structure live?

Structure is looked for at every place (`calib.diagnose.places`) by a score test: with the functions F of a driver and
what the residual has along a direction, reading by reading, as s,

    T = |F's|^2 / |r|^2,

which is r'Kr for the kernel K that driver and direction make, without forming it. Its distribution without structure,
and that of the largest over all places, come from the same residuals with the signs of whole poses drawn anew
(`calib.diagnose.null`). The test is free of the size of the noise. Source: Lin 1997 (score tests with kernels).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import log_ndtr

from calib.diagnose.null import Chance, draws, poses_of
from calib.diagnose.places import TOGETHER, along, directions, drivers
from calib.diagnose.space import Space
from calib.kinematics import Array

ALARM = 0.001  # chance that a data set without structure raises an alarm, over all places
NOISY = 0.001  # chance that noise of the declared size fails the chi-square
_MOST_READINGS = 3000  # that the test looks at, of poses drawn at random
_MOST_PLACES = 8
_ABSORBED = 0.05  # share of what a place would show that must be left beside the model
_FEWEST = 10.0  # readings over which the functions of a driver act at least
_FEWEST_REPEATS = 30  # rows by which noise is known from repeats


@dataclass(frozen=True)
class Structure:
    """Left-over structure: what drives it, on what it acts, how sure, and what share of the left-over variance it
    is."""

    where: str
    p_value: float
    explained_variance: float
    acts_on: str = "the tool point"


def left_over(space: Space) -> list[Structure]:
    """Drivers along which structure is left, most certain first; empty where none passes."""
    if space.freedom <= 0 or space.rss <= 0.0:
        return []
    some = _some(space)
    rows = draws(space, clipped=True)
    size = np.sum(rows**2, axis=0)
    functions = {name: f[some] for name, f in drivers(space).items() if _spread(f[some]) > _FEWEST}
    squared = np.array([np.sum(f**2, axis=1) for f in functions.values()])
    stacked = np.ascontiguousarray(np.hstack(list(functions.values())).T)
    first = np.cumsum([0, *(f.shape[1] for f in functions.values())])[:-1]
    names: list[tuple[str, str]] = []
    each = np.zeros((0, rows.shape[1]))
    acting = directions(space)
    for direction, axes in acting.items():
        squares = sum((stacked @ along(axis, rows)[some]) ** 2 for axis in axes)
        scores = np.add.reduceat(squares, first, axis=0) / size
        raw = squared @ np.sum(axes[:, :, some] ** 2, axis=(0, 1)) / space.freedom
        seen = np.mean(scores[:, 1:], axis=1) > _ABSORBED * raw
        each = np.vstack([each, _log_p(scores[seen])])
        names += [(driver, direction) for driver, kept in zip(functions, seen, strict=True) if kept]
    chance = Chance.of(each[:, 1:])
    best: dict[str, int] = {}
    for i in np.argsort(each[:, 0]).tolist():
        best.setdefault(names[i][0], i)
    found = []
    for driver, i in best.items():
        p_value = chance.p_value(float(each[i, 0]))
        if p_value < ALARM and len(found) < _MOST_PLACES:
            acts_on = names[i][1]
            share = _share(space, functions[driver], acting[acts_on], some)
            found.append(Structure(driver, p_value, share, acts_on))
    # What any function of the joints would show names no place where a narrower one does.
    return sorted(found, key=lambda s: s.where == TOGETHER)


def p_lack_of_fit(space: Space) -> float:
    """Chance that noise of the declared size leaves this much."""
    return float(stats.chi2.sf(float(np.sum(space.residual**2)), max(space.freedom, 1)))


def p_beyond_repeats(space: Space) -> float | None:
    """Chance that the noise which repeated readings show leaves this much; None where too few are repeated.

    Repeats are readings of one target in one pose, arrived at from the same sides: what differs among them is noise,
    with the robot's repeatability. Source: the lack-of-fit F test, Draper and Smith ch. 2.
    """
    conditions = space.fitted.readings.conditions
    same = np.column_stack([poses_of(conditions), conditions.target, conditions.anchor, conditions.series])
    same = np.column_stack([same, conditions.side.astype(np.int64)])
    _, group, count = np.unique(same, axis=0, return_inverse=True, return_counts=True)
    group = group.reshape(-1)
    sums = np.zeros((len(space.residual), len(count)))
    for row, values in zip(sums, space.residual, strict=True):
        np.add.at(row, group, values)
    freedom = space.fitted.readings.observed.freedom
    first = np.unique(group, return_index=True)[1]
    pure_rows = int(freedom.sum() - freedom[first].sum())
    left = space.freedom - pure_rows
    if pure_rows < _FEWEST_REPEATS or left <= 0:
        return None
    pure = float(np.sum((space.residual - (sums / count)[:, group]) ** 2))
    ratio = (max(space.rss - pure, 0.0) / left) / max(pure / pure_rows, 1e-300)
    return float(stats.f.sf(ratio, left, pure_rows))


def _some(space: Space) -> NDArray[np.int64]:
    """Readings that the test looks at: all, or those of poses drawn at random."""
    pose = poses_of(space.fitted.readings.conditions)
    if len(pose) <= _MOST_READINGS:
        return np.arange(len(pose))
    rank = np.random.default_rng(1).permutation(int(pose.max()) + 1)[pose]
    return np.sort(np.argsort(rank, kind="stable")[:_MOST_READINGS])


def _spread(functions: Array) -> float:
    """Over how many readings functions (n, m) act: where one or two dominate, their signs say nothing."""
    weight = np.sum((functions - functions.mean(axis=0)) ** 2, axis=1)
    return float(np.sum(weight) ** 2 / max(np.sum(weight**2), 1e-300))


def _log_p(values: Array) -> Array:
    """log of the chance that draws exceed each value (tests, 1 + B), the data first, by the gamma law of mean and
    variance of the draws, of the others for a draw itself. Source: Wilson and Hilferty 1931, which does not
    underflow."""
    drawn = values[:, 1:]
    count = np.full(values.shape[1], drawn.shape[1] - 1.0)
    count[0] += 1.0
    itself = np.where(count < count[0], values, 0.0)
    mean = np.maximum((np.sum(drawn, axis=1, keepdims=True) - itself) / count, 1e-300)
    variance = (np.sum(drawn**2, axis=1, keepdims=True) - itself**2) / count - mean**2
    shape = mean**2 / np.maximum(variance, 1e-6 * mean**2)
    return log_ndtr(-(np.cbrt(values / mean) - 1.0 + 1.0 / (9.0 * shape)) * 3.0 * np.sqrt(shape))


def _share(space: Space, functions: Array, axes: Array, some: NDArray[np.int64]) -> float:
    """Share of the left-over variance that the functions explain along some axes, their number allowed for."""
    n = len(functions)
    columns = np.einsum("akn,nf->knaf", axes[:, :, some], functions).reshape(space.residual.shape[0] * n, -1)
    left = space.residual[:, some].ravel()
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-3 * max(float(s[0]), 1e-300)]
    rows = max(space.rows * n // space.residual.shape[1], u.shape[1] + 1)
    gain, total = float(np.sum((u.T @ left) ** 2)), float(left @ left)
    return float(np.clip(1.0 - (1.0 - gain / total) * rows / max(rows - u.shape[1], 1), 0.0, 1.0))
