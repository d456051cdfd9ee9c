"""Control charts of a parameter: of single values (Shewhart) and of their mean (EWMA).

The first values, the reference, determine the centre and the scatter of the parameter:

    centre = mean of the reference,     between^2 = (v d^2 + 6 u^2) / (v + 6) - u^2, 0 or more

with d the mean moving range over 1.128, v its degrees of freedom, and u^2 the mean square of the stated standard
uncertainties. A later value i scatters by sigma_i^2 = between^2 + u_i^2. The mean z_i = g y_i + (1 - g) z_(i-1), with
z = centre before the first, scatters by the exact sum of its weights. The uncertainty of the centre is in both.

Limits are quantiles of Student's t with v + 6 degrees of freedom (v without U). A value of a steady parameter is then
a signal at most at the stated rate, half of it for each chart. A signal is a value, or its mean, outside its limits.
There are no rules about runs: each adds false alarms, and the mean detects what they detect.

Sources: ISO 7870-2 and NIST/SEMATECH e-Handbook 6.3.2.2 (moving range), Roberts 1959 and e-Handbook 6.3.2.4 (EWMA),
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
    """Value outside the limits of one of the charts.

    Attributes
    ----------
    index : int
        Index of the value, oldest first.
    """

    index: int
    chart: Literal["value", "mean"]
    because: str


@dataclass(frozen=True)
class ControlChart:
    """Control chart of n values, oldest first.

    Attributes
    ----------
    values, mean : array of shape (n,)
        Values, and their weighted means.
    limits, mean_limits : array of shape (n, 2)
        Limits of each; infinite for a value that is the only reference.
    centre, sigma : float
        Mean of the reference, and its scatter including the uncertainties of the values.
    freedom : float
        Degrees of freedom of the limits' quantile.
    reference : int
        Number of first values that determine centre and sigma.
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
    """Build the control chart of a history.

    Parameters
    ----------
    rate : float, optional
        Signals of a steady parameter per value, both charts together.
    weight : float, optional
        Weight of the newest value in the mean.
    reference : int, optional
        Number of first values that form the reference. Default: up to ten, fewer for a short history. The newest value
        is then never part of the reference, unless it is alone.

    Raises
    ------
    DataError
        The history is empty or shorter than the reference, or a rate or weight is outside 0 to 1.
    """
    checks = in_order(history)
    for key, share in (("rate", rate), ("weight", weight)):
        if not 0.0 < share < 1.0:
            raise DataError(f"is {share:g}.", do="Give a share between 0 and 1.", key=key)
    first = max(1, min(REFERENCE, len(checks) - 1)) if reference is None else reference
    if not 1 <= first <= len(checks):
        raise DataError(
            f"has {len(checks)} values, and the reference needs {first}.",
            do="Reduce the number of reference values.",
            key="reference",
        )
    values = np.array([check.value for check in checks])
    u = np.array([check.u / 2.0 for check in checks])
    centre = float(np.mean(values[:first]))
    between, freedom = _scatter(values[:first], u[:first])
    if between + np.max(u) == 0.0:
        raise DataError(
            "has values without U that do not scatter, so that their chance error is unknown.",
            do="Give U with the values.",
            key="history",
        )
    variance = between + u**2
    of_centre = float(np.mean(variance[:first])) / first
    k = float(stats.t.isf(rate / 4.0, freedom))
    # a value of the reference moves the centre, and a single one is the centre; a later value does not
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
    """Estimate the variance between values (n,) beyond their standard uncertainties u (n,).

    Also returns the degrees of freedom for the sum.
    """
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
    """Compute the weights (n, n) of the values in each mean, one mean per row.

    The mean begins after the reference.
    """
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
