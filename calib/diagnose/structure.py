"""Tests of the residuals of a fit for structure, and along which quantity the structure is.

Structure is looked for at every place (`calib.diagnose.places`) by a score test: with the functions F of a driver and
what the residual has along a direction, reading by reading, as s,

    T = |F's|^2 / |r|^2,

which is r'Kr for the kernel K that driver and direction make, without forming it. Its distribution without structure,
and that of the largest over all places, come from the same residuals with the signs of whole poses drawn anew
(`calib.diagnose.null`). The test is free of the size of the noise. Source: Lin 1997 (score tests with kernels).
Each place is tested with two weightings, with slow functions weighted most and with all weighted equally, because an
interaction of orders 2 and 3 is hidden by the slow functions of its two joints. The smaller p counts, for the data as
for the draws.

Places that one would look at first (`likely`) share half of the chance of an alarm among them, all others the other
half. Source: Genovese, Roeder and Wasserman 2006 (weighted p-values).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import log_ndtr

from calib.array import Array
from calib.diagnose.null import DRAWS, Chance, draws
from calib.diagnose.places import TOGETHER, along, directions, drivers, likely
from calib.scan.space import Space

ALARM = 0.001  # chance that a data set without structure raises an alarm, over all places
# The alarm where declared noise does not explain what is left: that alone is rarer than an alarm
SUSPECT = 0.01
_MOST_READINGS = 3000  # that the test looks at, of poses drawn at random
_MOST_PLACES, _MOST_DIRECTIONS = 8, 3
_SKEWNESS = 0.1, 8.0  # of a sum of squares: nearly normal, to carried by one
# Draws that make sure how rare the largest of all places is; fewer where readings are many.
_DRAWS, _MOST_NUMBERS = 999, 600_000
_ABSORBED = 0.05  # share of what a place would show that must be left beside the model
_FAINT = 1e-4  # mean square of a function that is hardly one
_SAME = 1e-6  # of a function whose mean square is about 1
_LEAST_SHARE = 0.0005  # of what is left, that a place must explain to be one
_CHANCE_OF_SHARE = 3.0  # standard deviations by which the share of a set of functions varies by chance
_FEWEST = 10.0  # readings over which the functions of a driver act at least


@dataclass(frozen=True)
class Structure:
    """Left-over structure: what drives it, on what it acts, how sure, and what share of the left-over variance it
    is."""

    where: str
    p_value: float
    explained_variance: float
    acts_on: str = "the tool point"


def left_over(space: Space, alarm: float = ALARM) -> list[Structure]:
    """Drivers along which structure is left, that which explains most first; empty where none passes at a chance of
    `alarm`."""
    if space.freedom <= 0 or space.rss <= 0.0:
        return []
    some = _some(space)
    rows = draws(space, clipped=True, most=max(min(_DRAWS, _MOST_NUMBERS // space.size), DRAWS))
    length = np.linalg.norm(rows, axis=0)
    if not np.all(length > 0.0):  # most readings fit exactly, so that clipping leaves nothing
        return []
    rows /= length
    functions = {name: f[some] for name, f in drivers(space).items() if _spread(f[some]) > _FEWEST}
    squared = np.array([np.sum(f**2, axis=1) for f in functions.values()])
    pulled, alike = space.pulled(rows), _alike(space, functions, some)
    # Single precision, which chance does not notice, for it is most of the time of a diagnosis that finds nothing
    stacked = np.ascontiguousarray(np.hstack(list(functions.values())).T, dtype=np.float32)
    first = np.cumsum([0, *(f.shape[1] for f in functions.values())])[:-1]
    even = (1.0 / np.maximum(np.mean(stacked**2, axis=1), _FAINT))[:, None]
    names: list[tuple[str, str]] = []
    each = np.zeros((0, rows.shape[1]))
    acting = directions(space)
    for direction, axes in acting.items():
        squares = sum((stacked @ along(axis, pulled)[some].astype(np.float32)) ** 2 for axis in axes)
        scores = np.add.reduceat(squares, first, axis=0)
        evenly = np.add.reduceat(squares * even, first, axis=0)
        of_visits = np.sum(space.fitted.readings.observed.by_visit(axes)[:, :, some] ** 2, axis=(0, 1))
        of_readings = np.sum(axes[:, :, some] ** 2, axis=(0, 1))
        raw = np.where(alike, squared @ of_visits, squared @ of_readings) / space.freedom
        seen = np.mean(scores[:, 1:], axis=1) > _ABSORBED * raw
        each = np.vstack([each, log_p_of(scores[seen].astype(float), evenly[seen].astype(float))])
        names += [(driver, direction) for driver, kept in zip(functions, seen, strict=True) if kept]
    first_of = np.array([likely(*name) for name in names])
    each += np.log(np.where(first_of, np.sum(first_of), np.sum(~first_of)) + 1e-9)[:, None]
    chance = Chance.of(each[:, 1:])
    found: dict[str, list[Structure]] = {}
    for i in np.argsort(each[:, 0]).tolist():
        driver, acts_on = names[i]
        p_value = chance.p_value(float(each[i, 0]))
        if p_value >= alarm or (driver not in found and len(found) == _MOST_PLACES):
            break
        if len(found.setdefault(driver, [])) < _MOST_DIRECTIONS:
            share = _share(space, functions[driver], acting[acts_on], some)
            found[driver].append(Structure(driver, p_value, share, acts_on))
    # Beyond all doubt p-values rank no more: what a place explains does. What any function of the joints would show
    # names no place where a narrower one does.
    places = [max(of_driver, key=lambda s: s.explained_variance) for of_driver in found.values()]
    places = [place for place in places if place.explained_variance >= _LEAST_SHARE]
    places.sort(key=lambda s: (s.where == TOGETHER, -s.explained_variance))
    if places:
        best = places[0]
        rows = space.rows * len(some) / space.residual.shape[1]
        chance = _CHANCE_OF_SHARE * np.sqrt(2.0 * functions[best.where].shape[1]) / rows
        alike = [s for s in places if best.explained_variance - s.explained_variance < chance]
        simplest = min(alike, key=lambda s: _variables(s.where))
        if _variables(simplest.where) < _variables(best.where):
            places.insert(0, places.pop(places.index(simplest)))
    return places


def _variables(driver: str) -> int:
    """The number of quantities that a driver needs."""
    return 3 if driver == TOGETHER else 1 + driver.count(" and ")


def _some(space: Space) -> NDArray[np.int64]:
    """Readings that the test looks at: all, or those of poses drawn at random."""
    pose = space.fitted.readings.conditions.pose
    if len(pose) <= _MOST_READINGS:
        return np.arange(len(pose))
    rank = np.random.default_rng(1).permutation(int(pose.max()) + 1)[pose]
    return np.sort(np.argsort(rank, kind="stable")[:_MOST_READINGS])


def _alike(space: Space, functions: Mapping[str, Array], some: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Drivers, of functions (s, m) over `some` readings (s,), as a mask of those that are the same in all readings
    of a visit."""
    _, first, visit = np.unique(
        space.fitted.readings.conditions.visit[some], return_index=True, return_inverse=True
    )
    one = first[visit.reshape(-1)]
    return np.array([bool(np.all(np.abs(f - f[one]) < _SAME)) for f in functions.values()])


def _spread(functions: Array) -> float:
    """Over how many readings functions (n, m) act: where one or two dominate, their signs say nothing."""
    weight = np.sum((functions - functions.mean(axis=0)) ** 2, axis=1)
    return float(np.sum(weight) ** 2 / max(np.sum(weight**2), 1e-300))


def log_p_of(*statistics: Array) -> Array:
    """log of the chance that draws exceed each value (tests, 1 + B), the data first; of several statistics of the same
    tests the smallest."""
    return log_ndtr(np.min([_deviate(values) for values in statistics], axis=0))


def _deviate(values: Array) -> Array:
    """Values (tests, 1 + B) as deviates of a normal law, high ones negative, by the gamma law of mean, variance and
    skewness of the draws, of the others for a draw itself. A law of mean and variance alone believes too much where few
    readings carry a place. Source: Pearson's type III; Wilson and Hilferty 1931, which does not underflow."""
    size = np.maximum(np.mean(values[:, 1:], axis=1, keepdims=True), 1e-300)
    values = values / size
    count = np.full(values.shape[1], values.shape[1] - 2.0)
    count[0] += 1.0
    powers = []
    for k in (1, 2, 3):
        power = values**k
        total = np.sum(power[:, 1:], axis=1, keepdims=True)
        power[:, 1:] = total - power[:, 1:]
        power[:, :1] = total
        powers.append(power / count)
    mean, square, cube = powers
    # of the draws about a mean of 1; where one draw holds all that a place has, the others have neither
    variance = np.maximum(square - mean**2, np.maximum(1e-6 * mean**2, 1e-12))
    spread = np.sqrt(variance)
    skewness = np.clip((cube - 3.0 * mean * square + 2.0 * mean**3) / (variance * spread), *_SKEWNESS)
    shape = 4.0 / skewness**2
    gamma = np.maximum(1.0 + (values - mean) / (spread * np.sqrt(shape)), 1e-9)
    return -(np.cbrt(gamma) - 1.0 + 1.0 / (9.0 * shape)) * 3.0 * np.sqrt(shape)


def _share(space: Space, functions: Array, axes: Array, some: NDArray[np.int64]) -> float:
    """Share of the left-over variance that the functions explain along some axes, their number allowed for.

    Of more functions than a third of the rows the first ones count: as many as rows would explain everything.
    """
    n = len(functions)
    measured = space.rows * n // space.residual.shape[1]
    functions = functions[:, : max(measured // (3 * len(axes)), 1)]
    columns = np.einsum("akn,nf->afkn", axes[:, :, some], functions)
    columns = space.fitted.readings.observed.take(some).by_visit(columns)
    columns = columns.reshape(-1, space.residual.shape[0] * n).T
    left = space.residual[:, some].ravel()
    u, s, _ = np.linalg.svd(columns, full_matrices=False)
    u = u[:, s > 1e-3 * max(float(s[0]), 1e-300)]
    rows = max(measured, u.shape[1] + 1)
    gain, total = float(np.sum((u.T @ left) ** 2)), float(left @ left)
    return float(np.clip(1.0 - (1.0 - gain / total) * rows / max(rows - u.shape[1], 1), 0.0, 1.0))
