"""The parts of every joint's range that a selection visits, and the poses that fill what it leaves out.

D-optimal poses crowd at the ends of the joints. What is missing in the model (periodic errors, encoder scale,
backlash beyond a sign of the torque) is seen only where a joint has been: so the range of every joint is cut into
equal bins, and each bin that some candidate reaches has to hold a pose.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

BINS = 8

Mask = NDArray[np.bool_]


def cells_of(joints: Array, bins: int = BINS) -> Mask:
    """(N, J, bins) in which bin of its range, lowest to highest of all candidates, every joint (N, J) lies."""
    low, high = joints.min(axis=0), joints.max(axis=0)
    share = (joints - low) / np.where(high > low, high - low, 1.0)
    number = np.minimum((share * bins).astype(np.int64), bins - 1)
    return number[:, :, None] == np.arange(bins)


def missing(cells: Mask, selection: Sequence[int] | NDArray[np.int64]) -> Mask:
    """(J, bins) reached by a candidate of `cells` (N, J, bins), but by none of the selection."""
    visited = cells[np.asarray(selection, dtype=np.int64)]
    return np.logical_and(np.any(cells, axis=0), np.logical_not(np.any(visited, axis=0)))


def filling(cells: Mask, wanted: Mask, most: int, merit: Array) -> list[int]:
    """The candidates, at most `most`, that together fill the wanted cells (J, bins), the one that fills most first.

    Among equals the one of higher merit (N,). Fewer than needed where `most` does not suffice.
    """
    wanted = wanted.copy()
    chosen: list[int] = []
    while wanted.any() and len(chosen) < most:
        fills = (cells & wanted).sum(axis=(1, 2))
        equal = np.flatnonzero(fills == fills.max())
        chosen.append(int(equal[np.argmax(merit[equal])]))
        wanted &= ~cells[chosen[-1]]
    return chosen
