"""The choice among the configurations of a pose: whole turns within the limits, and the branch near a seed.

The angles may be a model's or a controller's: joint matrices of whole numbers carry whole turns into whole turns.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

TURN = 2.0 * np.pi
EDGE = 1e-9  # rad: an angle on the limit itself is within it


def nearest_turns(
    angles: Array, seed: Array, lower: Array, upper: Array, *, slides: Sequence[int] = ()
) -> Array:
    """(..., N) the turn of every angle that lies within its limits (N,) and nearest to `seed`; NaN where none does.

    seed: (..., N), broadcast against `angles`. slides: numbers of joints, from 1, that have no turns. rad or mm.
    """
    first = np.ceil((lower - EDGE - angles) / TURN)
    last = np.floor((upper + EDGE - angles) / TURN)
    wanted = np.round((seed - angles) / TURN)
    for k in slides:
        inside = (lower[k - 1] - EDGE <= angles[..., k - 1]) & (angles[..., k - 1] <= upper[k - 1] + EDGE)
        first[..., k - 1], last[..., k - 1], wanted[..., k - 1] = 0.0, np.where(inside, 0.0, -1.0), 0.0
    turned = angles + TURN * np.clip(wanted, first, last)
    return np.where(first <= last, turned, np.nan)


def within_limits(
    angles: Array, seed: Array, lower: Array, upper: Array, *, slides: Sequence[int] = ()
) -> Array:
    """(..., N) as `nearest_turns`, but NaN whole where one joint of a configuration has no turn within its limits."""
    turned = nearest_turns(angles, seed, lower, upper, slides=slides)
    return np.where(np.all(np.isfinite(turned), axis=-1, keepdims=True), turned, np.nan)


def nearest_branch(configurations: Array, seed: Array) -> NDArray[np.int64]:
    """(n,) which of the configurations (n, branches, N), NaN where there is none, lies nearest to `seed` (n, N).

    Nearest by the sum of squared joint differences; -1 where all are NaN. `seed` may be (N,), for all.
    """
    away = np.sum((configurations - np.expand_dims(seed, -2)) ** 2, axis=-1)
    away = np.where(np.isfinite(away), away, np.inf)
    best = np.argmin(away, axis=-1)
    return np.where(np.isfinite(np.min(away, axis=-1)), best, -1)
