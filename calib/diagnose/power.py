"""The power of the readings: the smallest size of each effect that would have been found in 95 of 100 cases.

With A = X'PX what the readings know of an effect's columns beside the model, and s the noise, an effect of amplitudes b
raises the fall of the residual squares by lambda = b'A b / s^2, and a claim needs a fall that chance reaches once in
500 sets, all tries counted; more where the noise along the effect happens to be larger than elsewhere
(`against_own_noise`). That is known from some stretches of the campaign, so by a chi-square of as many degrees of
freedom, and the power is the mean over it. The size is that of the direction of b which shows least. Source:
noncentral chi-square, Johnson, Kotz and Balakrishnan ch. 29.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from scipy.special import chndtr, chndtrinc, fdtri, gammaincinv

from calib.array import Array
from calib.diagnose.claims import STRETCHES
from calib.scan.evidence import CLAIM
from calib.scan.scores import ABSORBED, Scores
from calib.units import to_display

POWER = 0.95
_ABSURD = 100.0  # times the usual size: no robot has it, so that the readings cannot show the effect
_QUANTILES = 32  # of the noise along an effect


@dataclass(frozen=True)
class Visible:
    """The smallest detectable size of an effect, in `unit`; None where these readings cannot show it."""

    label: str
    size: float | None
    unit: str


def visible(scores: Scores) -> tuple[Visible, ...]:
    """The smallest detectable size of every effect of the library; for a scan, the median over its places."""
    found = []
    for index, family in enumerate(scores.families):
        places = len(family.raw)
        effect = family.effect(places // 2)
        units = [parameter.unit for parameter in effect.parameters]
        first = [i for i, unit in enumerate(units) if unit == units[0]]
        least = _least(scores.a[index][:, first][:, :, first], family.raw[:, first])
        needed = _needed(len(units), scores.freedom, scores.multiplicity(index, places // 2))
        typical = float(np.median(least))
        size = np.sqrt(needed * scores.noise / typical) if typical > 0.0 else None
        shown = None if size is None else to_display(float(size), units[0])
        usual = effect.parameters[0].size
        if shown is not None and usual is not None and shown > _ABSURD * usual:
            shown = None
        found.append(Visible(family.label, shown, units[0]))
    return tuple(found)


def _least(a: Array, raw: Array) -> Array:
    """(places,) smallest eigenvalue of A (places, p, p) over directions that the model does not absorb; 0: all are."""
    values = np.linalg.eigvalsh(a)
    counts = values > ABSORBED * np.max(raw, axis=1, keepdims=True)
    return np.where(counts.any(axis=1), np.min(np.where(counts, values, np.inf), axis=1), 0.0)


@lru_cache(maxsize=256)
def _needed(columns: int, freedom: int, tries: int) -> float:
    """lambda at which so many columns are claimed with the power wanted."""
    from scipy.optimize import root_scalar  # half a second that a service need not take to begin

    limit = columns * float(fdtri(columns, max(freedom - columns, 1), 1.0 - CLAIM / tries))
    least = float(chndtrinc(limit, columns, 1.0 - POWER))
    likely = (np.arange(_QUANTILES) + 0.5) / _QUANTILES
    # Of every column the sum over all stretches is zero: what it explains is taken out
    along = 2.0 * gammaincinv(0.5 * columns * (STRETCHES - 1), likely) / (columns * STRETCHES)
    limits = limit * np.maximum(along, 1.0)

    def missed(size: float) -> float:
        return float(np.mean(chndtr(limits, columns, size))) - (1.0 - POWER)

    highest = 2.0 * float(limits[-1]) + 4.0 * least
    return float(root_scalar(missed, bracket=(least, highest), xtol=1e-3 * least).root)
