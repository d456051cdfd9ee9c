"""Control charts of the values of a parameter: of single values (Shewhart) and of their weighted mean (EWMA).

The first values, the reference, say where the parameter lies and how it scatters:

    centre = mean of the reference,     X
A later value i scatters by sigma_i^2 = between^2 + u_i^2, and the mean z_i = g y_i + (1 - g) z_(i-1), z = centre before
the first, by the exact sum of its weights; the centre's own uncertainty is in both. Limits are quantiles of Student's t
with v + 6, v without U, so that a value of a steady parameter is a signal at most at the stated rate, half of it for
each chart. What counts as a signal: a value, or its mean, outside its limits. No rules about runs: each adds
false alarms, and the mean finds what they find.

Sources: ISO 7870-2 and NIST/SEMATECH e-Handbook 6.3.2.2 (moving range); Roberts 1959 and e-Handbook 6.3.2.4 (EWMA);
Cryer and Ryan 1990 (variance of the mean moving range).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from calib.array import Array
from calib.errors import DataError
from calib.upkeep.due import Check, in_order

RATE = 0.01
"""Signals of a steady parameter, a value."""

WEIGHT = 0.2
REFERENCE = 10
BELIEVED = 6.0
"""Degrees of freedom that the stated U of the values is worth beside their scatter. Where there are few values it says
more than their moving range, and it is no proof that nothing else scatters: with 6, drawn histories whose scatter is up
to 1.4 times the stated have no more signals than stated, from the second value on."""
_MOVING_RANGE = 2.0 / np.sqrt(np.pi)  # mean distance of two values, in standard deviations: 1.128


@dataclass(frozen=True)
class Signal:
    """A value outside the limits of one of the charts; index: of the value, oldest first."""

    index: int
    chart: Literal["value", "mean"]
    because: str


@dataclass(frozen=True)
class ControlChart:
    """Values (n,), oldest first; centre; limits (n, 2) of every value, infinite where it alone is the reference;
    mean (n,) and mean_limits (n, 2); signals.

    reference: how many of the first values made centre and sigma; sigma: their scatter, what they are uncertain by
    included; freedom: of the limits' quantile.
    """

    values: Array
    centre: float
    sigma: float
    freedom: float
    reference: int
    limits: Array
    mean: Array
    mean_limits: Array
    signals: tuple[Signal, ...]
    rate: float


def chart_of(
    history: Sequence[Check], rate: float = RATE, weight: float = WEIGHT, reference: int | None = None
) -> ControlChart:
    """The chart of a history. rate: signals of a steady parameter, a value, both charts together; weight: of the newest
    value in the mean; reference: how many first values are the reference, None for up to ten, fewer where the
    history is short: the newest value is then never judged by itself.

    Raises DataError for an empty history, a rate or weight outside 0 to 1, and a reference that it does not have.
    """
    checks = in_order(history)
    for key, share in (("rate", rate), ("weight", weight)):
        if not 0.0 < share < 1.0:
            raise DataError(f"is {share:g}.", do="Give a share between 0 and 1.", key=key)
    first = max(1, min(REFERENCE, len(checks) - 1)) if reference is None else reference
    if not 1 <= first <= len(checks):
        raise DataError(
            f"has {len(checks)} values, and {first} are wanted as the reference.",
            do="Take fewer.",
            key="reference",
        )
    values = np.array([check.value for check in checks])
    u = np.array([check.u / 2.0 for check in checks])
    centre = float(np.mean(values[:first]))
    between, freedom = _scatter(values[:first], u[:first])
    if between + np.max(u) == 0.0:
        raise DataError(
            "has values without U that do not scatter: nothing says what is chance.",
            do="Give U with the values.",
            key="history",
        )
    variance = between + u**2
    of_centre = float(np.mean(variance[:first])) / first
    k = float(stats.t.isf(rate / 4.0, freedom))
    # a value of the reference draws the centre after itself, and one that is alone is the centre; a later one does not
    later = np.arange(len(values)) >= first
    among = variance * (1.0 - 2.0 / first) + of_centre if first > 1 else np.inf
    half = k * np.sqrt(np.where(later, variance + of_centre, among))
    weights = _weights(len(values), first, weight)
    mean = centre + weights @ (values - centre)
    mean_half = k * np.sqrt(weights**2 @ variance + np.sum(weights, axis=1) ** 2 * of_centre)
    limits, mean_limits = (
        centre + np.column_stack([-each, each]) for each in (half, np.where(later, mean_half, np.inf))
    )
    signals = [
        *_outside("value", checks, values, centre, half),
        *_outside("mean", checks, mean, centre, np.where(later, mean_half, np.inf)),
    ]
    return ControlChart(
        values,
        centre,
        float(np.sqrt(np.mean(variance[:first]))),
        freedom,
        first,
        limits,
        mean,
        mean_limits,
        tuple(sorted(signals, key=lambda signal: signal.index)),
        rate,
    )


def _scatter(values: Array, u: Array) -> tuple[float, float]:
    """Variance between values (n,) beyond their standard uncertainties u (n,), and the freedom of the sum of both."""
    n = len(values)
    stated = float(np.mean(u**2))
    believed = BELIEVED if stated > 0.0 else 0.0
    if n < 2:
        return 0.0, believed
    freedom = (n - 1) ** 2 / (2.0 * (0.8264 * n - 1.082))
    found = float(np.mean(np.abs(np.diff(values))) / _MOVING_RANGE) ** 2
    both = (freedom * found + believed * stated) / (freedom + believed)
    return max(both - stated, 0.0), freedom + believed


def _weights(count: int, first: int, weight: float) -> Array:
    """(n, n) row i: the weights of the values in the mean at i, which begins after the reference."""
    back = np.arange(count)[:, None] - np.arange(count)[None]
    taken: NDArray[np.bool_] = (back >= 0) & (np.arange(count)[None] >= first)
    return np.where(taken, weight * (1.0 - weight) ** np.maximum(back, 0), 0.0)


def _outside(
    chart: Literal["value", "mean"], checks: Sequence[Check], values: Array, centre: float, half: Array
) -> list[Signal]:
    name = "is" if chart == "value" else "has a weighted mean with those before it of"
    return [
        Signal(
            i,
            chart,
            f"The value of {checks[i].at:%Y-%m-%d} {name} {values[i]:.4g}, {abs(values[i] - centre):.2g} from the "
            f"centre {centre:.4g}; the limit is {half[i]:.2g}.",
        )
        for i in np.flatnonzero(np.abs(values - centre) > half).tolist()
    ]
