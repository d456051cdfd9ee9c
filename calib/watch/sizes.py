"""What some check poses will show: of each cause the smallest size that is seen, and from which size it is named alone.

Seen: the alarm is raised in 95 of 100 watches, by the cause's own chi-squared at the limit that all questions share.
Named alone: in 80 of 100, counted in draws. Of several parameters of one unit, such as the three directions of a tool,
the direction is the one that is seen worst.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import chndtrinc

from calib.array import Array
from calib.units import to_internal
from calib.watch.judge import RATE, odds_of
from calib.watch.odds import Odds
from calib.watch.seen import Seen

SEEN, ALONE = 0.95, 0.80
_TIMES = (1.0, 1.25, 1.5, 2.0, 3.0, 5.0, 10.0)  # of the smallest size, at which names are counted
_DRAWS = 400


@dataclass(frozen=True)
class Smallest:
    """What is seen of one cause: smallest size and its unit; from which size it is named alone, None where that takes
    more than ten times as much; always: labels of causes that no size tells from it."""

    label: str
    meaning: str
    size: float
    alone: float | None
    unit: str
    always: tuple[str, ...]


def smallest(seen: Seen, rate: float = RATE) -> tuple[tuple[Smallest, ...], tuple[str, ...]]:
    """Smallest change seen of every cause, and the labels of those that these poses do not show at all."""
    whiten, odds = odds_of(seen)
    limit = odds.limit(rate)
    rng = np.random.default_rng(7)
    noise = rng.normal(size=(_DRAWS, odds.rows))
    out = []
    for index, cause in enumerate(odds.causes):
        columns = whiten @ seen.columns[seen.causes.index(cause.effect)]
        effect = cause.effect
        unit = effect.parameters[0].unit
        same = [k for k, p in enumerate(effect.parameters) if p.unit == unit]
        one = columns[:, same] * to_internal(1.0, unit)
        values, vectors = np.linalg.eigh(one.T @ one)
        if values[0] < 1e-12:
            continue
        size = float(np.sqrt(needed(cause.freedom, limit) / values[0]))
        always = tuple(odds.causes[d].effect.label for d in odds.always(index))
        alone = None if always else _alone(odds, index, one @ vectors[:, 0] * size, noise)
        out.append(
            Smallest(
                effect.label, effect.meaning, size, None if alone is None else alone * size, unit, always
            )
        )
    found = {each.label for each in out}
    return tuple(out), tuple(e.label for e in seen.causes if e.label not in found)


def needed(freedom: int, p_limit: float, chance: float = SEEN) -> float:
    """The non-centrality with which chi-squared exceeds the limit of a p-value in so many of all cases."""
    limit = stats.chi2.isf(p_limit, freedom)
    return float(chndtrinc(limit, freedom, 1.0 - chance))


def _alone(odds: Odds, index: int, moved: Array, noise: Array) -> float | None:
    """The multiple of a displacement (q,) from which the cause is named alone, in draws of noise (d, q)."""
    for times in _TIMES:
        named = odds.named(times * moved + noise)
        if np.mean(named.alone & (named.best == index)) >= ALONE:
            return times
    return None
