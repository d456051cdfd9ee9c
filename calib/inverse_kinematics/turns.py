"""Whole turns: which of theta + 2 pi k lie within the limits of a joint, and which of them is nearest to a seed.

The angles may be a model's or a controller's: joint matrices of whole numbers carry whole turns into whole turns.
"""

from __future__ import annotations

import itertools

import numpy as np

from calib.kinematics import Array

TURN = 2.0 * np.pi
EDGE = 1e-9  # rad: an angle on the limit itself is within it


def nearest_turns(angles: Array, seed: Array, lower: Array, upper: Array) -> Array:
    """(..., N) the turn of every angle that lies within its limits (N,) and nearest to `seed`; NaN where none does.

    seed: (..., N), broadcast against `angles`. All rad.
    """
    first = np.ceil((lower - EDGE - angles) / TURN)
    last = np.floor((upper + EDGE - angles) / TURN)
    wanted = np.round((seed - angles) / TURN)
    turned = angles + TURN * np.clip(wanted, first, last)
    return np.where(first <= last, turned, np.nan)


def all_turns(angles: Array, lower: Array, upper: Array) -> Array:
    """(k, N) every combination of whole turns of one configuration (N,) within the limits (N,), rad; k may be 0."""
    first = np.ceil((lower - EDGE - angles) / TURN)
    last = np.floor((upper + EDGE - angles) / TURN)
    if not np.all(np.isfinite(angles)):
        return np.empty((0, len(angles)))
    each = [
        angle + TURN * np.arange(begin, end + 1.0)
        for angle, begin, end in zip(angles, first, last, strict=True)
    ]
    return np.array(list(itertools.product(*each))).reshape(-1, len(angles))
