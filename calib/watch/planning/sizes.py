"""Detectable sizes of check poses: the smallest size of each cause, and its identification.

A cause is detected if the alarm is raised in 95 of 100 watches, by its own chi-squared at the limit that all tests
share. It is identified if it is named alone in 80 of 100 draws. For several parameters of one unit, such as the three
directions of a tool, the direction that is detected worst counts.

The module also states the sizes that a watch should detect, and the non-centrality that readings need for that.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import chndtrinc

from calib.array import Array
from calib.model.effect import Effect
from calib.units import to_internal
from calib.watch.cause_evidence import CauseColumns, Odds
from calib.watch.judge import RATE, odds_of
from calib.watch.whitened_readings import WhitenedReadings

# Multiples of the smallest size at which identifications are counted
_TIMES = (1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0)
_DRAWS = 400
_NOTHING = 1e-12  # non-centrality of one unit
SEEN, ALONE = 0.95, 0.80
"""Shares of watches in which a cause is to be seen, and to be named alone."""

WANTED = {"joint_step": 0.01, "backlash": 0.01, "tool_shift": 0.1, "base_shift": 0.1}
"""Sizes that a watch should see, by the name of the cause, deg and mm: a tenth of what a new arm is off by."""


@dataclass(frozen=True)
class SmallestDetected:
    """Sizes at which one cause is detected.

    Attributes
    ----------
    size : float
        Smallest detected size, in `unit`.
    alone : float or None
        Size from which the cause is identified; None if that takes more than ten times as much.
    always : tuple of str
        Labels of causes that cannot be distinguished from it at any size.
    wanted : float or None
        Size that should be detected; None if no size is stated.
    share : float or None
        Share of watches in which `wanted` is detected.
    lever_mm : float or None
        For a cause of a joint, RMS distance of its axis from the targets, mm.
    """

    label: str
    meaning: str
    size: float
    alone: float | None
    unit: str
    always: tuple[str, ...]
    wanted: float | None = None
    share: float | None = None
    lever_mm: float | None = None


@dataclass(frozen=True)
class DetectableSizes:
    """Sizes of the causes that some visits detect.

    Attributes
    ----------
    causes : tuple of SmallestDetected
        Every cause that the visits show.
    unseen : tuple of str
        Labels of the causes that they do not show at all.
    limit : float
        P-value of an alarm.
    readings : int
        Number of readings.
    """

    causes: tuple[SmallestDetected, ...]
    unseen: tuple[str, ...]
    limit: float
    readings: int


def shown(seen: WhitenedReadings, rate: float = RATE) -> DetectableSizes:
    """Compute the smallest detected size of every cause."""
    whiten, odds = odds_of(seen)
    limit = odds.limit(rate)
    rng = np.random.default_rng(7)
    noise = rng.normal(size=(_DRAWS, odds.rows))
    out = []
    for index, cause in enumerate(odds.causes):
        effect = cause.effect
        worst = _worst(seen, effect, whiten)
        if worst is None:
            continue
        strength, moved = worst
        needs = needed(cause.freedom, limit)
        size = float(np.sqrt(needs / strength))
        always = tuple(odds.causes[d].effect.label for d in odds.always(index))
        alone = None if always else _alone(odds, index, moved * size, noise)
        joint = effect.label.partition(":j")[2]
        wanted = wanted_of(effect)
        beyond = stats.chi2.isf(limit, cause.freedom)
        out.append(
            SmallestDetected(
                effect.label,
                effect.meaning,
                size,
                None if alone is None else alone * size,
                effect.parameters[0].unit,
                always,
                wanted,
                None if wanted is None else float(stats.ncx2.sf(beyond, cause.freedom, wanted**2 * strength)),
                seen.lever_mm(int(joint)) if joint else None,
            )
        )
    found = {each.label for each in out}
    unseen = tuple(e.label for e in seen.causes if e.label not in found)
    return DetectableSizes(tuple(out), unseen, limit, len(seen.readings.conditions))


def seen_from(seen: WhitenedReadings, limit: float) -> dict[str, float]:
    """Compute the smallest detected size of every cause with a required size.

    The result is as from `shown`, but without its draws, and without a matrix of all rows, so it suits any number of
    rows.

    Parameters
    ----------
    limit : float
        P-value of an alarm.

    Returns
    -------
    dict
        Size by label, deg or mm; infinite if no reading shows the cause.
    """
    beside = np.column_stack([seen.lasting, seen.passing])
    inner = np.linalg.inv(np.eye(beside.shape[1]) + beside.T @ beside)
    out = {}
    for cause, columns in zip(seen.causes, seen.columns, strict=True):
        one = of_one_unit(cause, columns)
        along = beside.T @ one
        least = float(np.linalg.eigvalsh(one.T @ one - along.T @ inner @ along)[0])
        freedom = CauseColumns.of(cause, columns).freedom
        if wanted_of(cause) is not None:
            shows = freedom and least > _NOTHING
            out[cause.label] = float(np.sqrt(needed(freedom, limit) / least)) if shows else np.inf
    return out


def _worst(seen: WhitenedReadings, effect: Effect, whiten: Array) -> tuple[float, Array] | None:
    """Find the direction in which a cause is detected worst.

    Only parameters with the unit of the first one count. Returns the non-centrality of one unit squared, and the white
    residual (q,) of one unit. Returns None if no reading shows the cause.
    """
    one = whiten @ of_one_unit(effect, seen.columns[seen.causes.index(effect)])
    values, vectors = np.linalg.eigh(one.T @ one)
    return None if values[0] < _NOTHING else (float(values[0]), one @ vectors[:, 0])


def _alone(odds: Odds, index: int, moved: Array, noise: Array) -> float | None:
    """Return the multiple of a displacement (q,) from which the cause is identified.

    It is counted in draws of noise (d, q).
    """
    for times in _TIMES:
        named = odds.named(times * moved + noise)
        if np.mean(named.alone & (named.best == index)) >= ALONE:
            return times
    return None


def wanted_of(cause: Effect) -> float | None:
    """Return the size at which a cause should be detected, deg or mm; None if not stated."""
    stated = WANTED.get(cause.label.partition(":")[0])
    return stated if cause.parameters[0].unit in ("deg", "mm") else None


def of_one_unit(cause: Effect, columns: Array) -> Array:
    """Return the columns (q, w) of the parameters with the unit of the first one, per unit.

    The argument `columns` (q, p) contains all parameters of the cause, internal units.
    """
    unit = cause.parameters[0].unit
    same = [k for k, p in enumerate(cause.parameters) if p.unit == unit]
    return columns[:, same] * to_internal(1.0, unit)


def needed(freedom: int, p_limit: float) -> float:
    """Compute the non-centrality that exceeds a p-value's limit in the share `SEEN` of cases."""
    limit = stats.chi2.isf(p_limit, freedom)
    return float(chndtrinc(limit, freedom, 1.0 - SEEN))
