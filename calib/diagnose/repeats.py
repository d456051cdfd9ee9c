"""Tests of the residuals against the declared noise and the noise of repeats, and for an error of each pose.

Readings of one visit share where the robot came to rest, so three targets read at once are no three tries: unless the
repeatability is declared, and the rows are whitened for it, degrees of freedom count as if every visit had one reading.
Sources: the lack-of-fit F test, Draper and Smith ch. 2; degrees of
freedom of rows that belong together, Satterthwaite 1946.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc, fdtrc

from calib.array import Array
from calib.data.conditions import Conditions
from calib.diagnose.structure import ALARM, Structure
from calib.scan.space import Space

NOISY = 0.001  # chance that noise of the declared size fails the chi-square
EACH_POSE = "each pose by itself, the same at every visit"
_FEWEST = 30  # rows by which noise is known from repeats


def p_lack_of_fit(space: Space) -> float:
    """The p-value of the residuals for the declared noise."""
    freedom = max(space.rows - float(np.sum(space.basis_of_readings**2)), 1.0)
    apart = _apart(space, len(space.fitted.readings.rows))
    return float(chdtrc(freedom * apart, float(np.sum(space.residual**2)) * apart))


def p_beyond_repeats(space: Space) -> float | None:
    """The p-value of the residuals for the noise that repeated readings show; None where too few are repeated.

    Repeats are visits of one pose with one target, arrived at from the same sides: what differs among them is noise,
    with the robot's repeatability.
    """
    conditions = space.fitted.readings.conditions
    found = _between(space, np.column_stack([_place(conditions), conditions.side.astype(np.int64)]))
    return None if found is None else found[0]


def each_pose(space: Space) -> list[Structure]:
    """The place of an error that every pose and target has of its own, whenever it is visited; empty where none is."""
    found = _between(space, _place(space.fitted.readings.conditions))
    if found is None or found[0] >= ALARM:
        return []
    return [Structure(EACH_POSE, *found)]


def _place(conditions: Conditions) -> NDArray[np.int64]:
    """(n, 4) what is measured: pose, tool target, base target, series."""
    return np.column_stack([conditions.pose, conditions.target, conditions.anchor, conditions.series])


def _between(space: Space, alike: NDArray[np.int64]) -> tuple[float, float] | None:
    """Chance that visits of readings which are alike, where rows of `alike` (n, c) are, differ so much less than
    groups of them do, and the share of what is left that the groups have beyond it.

    None where too few are visited again, or the model has as many parameters as there are groups.
    """
    readings = space.fitted.readings
    groups = np.unique(alike, axis=0, return_inverse=True)[1].reshape(-1)
    _, first, one = np.unique(
        np.column_stack([groups, readings.conditions.visit]),
        axis=0,
        return_index=True,
        return_inverse=True,
    )
    visits = _means(space.residual, one.reshape(-1))
    group, rows = groups[first], readings.observed.freedom[first]
    middle = _means(visits, group)
    of_groups = int(rows[np.unique(group, return_index=True)[1]].sum())
    pure, left = int(rows.sum()) - of_groups, of_groups - space.basis.shape[1]
    if pure < _FEWEST or left <= 0:
        return None
    within = float(np.sum((visits - middle[:, group]) ** 2))
    between = float(np.sum(middle**2 * np.bincount(group)))
    noise = max(within / pure, 1e-300)
    apart = _apart(space, len(first))
    p_value = float(fdtrc(max(left * apart, 1.0), max(pure * apart, 1.0), between / left / noise))
    return p_value, max(between - left * noise, 0.0) / (between + within)


def _apart(space: Space, readings: int) -> float:
    """Share of so many readings that are tries of their own: all where what a visit shares is declared, and so is
    whitened already; else one a visit."""
    if space.fitted.readings.observed.shared is not None:
        return 1.0
    return len(np.unique(space.fitted.readings.conditions.visit)) / readings


def _means(values: Array, group: NDArray[np.int64]) -> Array:
    """(k, groups) mean of the columns of values (k, n) that belong to each group."""
    return np.array([np.bincount(group, row) for row in values]) / np.bincount(group)
