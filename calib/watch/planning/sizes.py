"""The sizes that some check poses will show: of each cause the smallest size that is seen, and from which size it is
named alone.

Seen: the alarm is raised in 95 of 100 watches, by the cause's own chi-squared at the limit that all questions share.
Named alone: in 80 of 100, counted in draws. Of several parameters of one unit, such as the three directions of a tool,
the direction is the one that is seen worst.

The sizes that a watch should see, and how much readings must say of a cause for that.
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

_TIMES = (1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0)  # of the smallest size, at which names are counted
_DRAWS = 400
_NOTHING = 1e-12  # non-centrality of one unit
SEEN, ALONE = 0.95, 0.80
"""Shares of watches in which a cause is to be seen, and to be named alone."""

WANTED = {"joint_step": 0.01, "backlash": 0.01, "tool_shift": 0.1, "base_shift": 0.1}
"""Sizes that a watch should see, by the name of the cause, deg and mm: a tenth of what a new arm is off by."""


@dataclass(frozen=True)
class SmallestDetected:
    """The sizes of one cause that are seen: smallest size and its unit; from which size it is named alone, None where
    that takes more than ten times as much; always: labels of causes that cannot be distinguished from it at any size.

    wanted: the size that should be seen, None where none is stated; share: of watches in which that is seen;
    lever_mm: of a joint's cause how far its axis is from the targets, root mean square, else None.
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
    """The yield of some visits: every cause; labels of those that they do not show at all; limit: the p-value of an
    alarm; readings: how many there are."""

    causes: tuple[SmallestDetected, ...]
    unseen: tuple[str, ...]
    limit: float
    readings: int


def shown(seen: WhitenedReadings, rate: float = RATE) -> DetectableSizes:
    """Smallest change seen of every cause."""
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
    """Smallest size of every cause that has a wanted one, at the p-value of an alarm: `shown` infinite where nothing
    shows it. `shown` without its draws, and without a matrix of all rows, however many there are."""
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
    """The worst of a cause: in the direction that is seen worst, of the parameters of its first unit: the
    non-centrality of the square of one unit, and the white residual (q,) of one unit; None where nothing is seen."""
    one = whiten @ of_one_unit(effect, seen.columns[seen.causes.index(effect)])
    values, vectors = np.linalg.eigh(one.T @ one)
    return None if values[0] < _NOTHING else (float(values[0]), one @ vectors[:, 0])


def _alone(odds: Odds, index: int, moved: Array, noise: Array) -> float | None:
    """The multiple of a displacement (q,) from which the cause is named alone, in draws of noise (d, q)."""
    for times in _TIMES:
        named = odds.named(times * moved + noise)
        if np.mean(named.alone & (named.best == index)) >= ALONE:
            return times
    return None


def wanted_of(cause: Effect) -> float | None:
    """The size at which a cause should be seen, deg or mm; None where none is stated."""
    stated = WANTED.get(cause.label.partition(":")[0])
    return stated if cause.parameters[0].unit in ("deg", "mm") else None


def of_one_unit(cause: Effect, columns: Array) -> Array:
    """(q, w) columns of the parameters of a cause that have the unit of its first one, of one unit each; columns
    (q, p): of all its parameters, internal units."""
    unit = cause.parameters[0].unit
    same = [k for k, p in enumerate(cause.parameters) if p.unit == unit]
    return columns[:, same] * to_internal(1.0, unit)


def needed(freedom: int, p_limit: float) -> float:
    """The non-centrality with which chi-squared exceeds the limit of a p-value in the share `SEEN` of all cases."""
    limit = stats.chi2.isf(p_limit, freedom)
    return float(chndtrinc(limit, freedom, 1.0 - SEEN))
