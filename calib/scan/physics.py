"""Physical bounds: an estimate that exceeds the bounds of its parameter by more than its noise excludes the effect.

A negative gap, or a gear that turns against its load, means that the readings show another effect that looks similar.
An estimate within its noise of the bound is accepted. The bounds are those that each effect declares in its own file.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.model.effect import Effect

_NOISE = 3.0  # standard errors beyond a bound that rule an effect out


def bounds_of(effect: Effect) -> Array | None:
    """(p, 2) lowest and highest value of every parameter, internal units; None where nothing is bounded."""
    bounds = np.array([parameter.bounds for parameter in effect.parameters])
    return bounds if np.any(np.isfinite(bounds)) else None


def impossible(bounds: Array, values: Array, errors: Array) -> NDArray[np.bool_]:
    """(...,) whether any of the values (..., p) with standard errors (..., p) lies outside the bounds (p, 2)."""
    low, high = bounds.T
    beyond = (values + _NOISE * errors < low) | (values - _NOISE * errors > high)
    return np.any(beyond, axis=-1)
