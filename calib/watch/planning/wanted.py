"""The sizes that a watch should see, and how much readings must say of a cause for that."""

from __future__ import annotations

from scipy import stats
from scipy.special import chndtrinc

from calib.array import Array
from calib.model.effect import Effect
from calib.units import to_internal

SEEN, ALONE = 0.95, 0.80
"""Shares of watches in which a cause is to be seen, and to be named alone."""

WANTED = {"joint_step": 0.01, "backlash": 0.01, "tool_shift": 0.1, "base_shift": 0.1}
"""Sizes that a watch should see, by the name of the cause, deg and mm: a tenth of what a new arm is off by."""


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
