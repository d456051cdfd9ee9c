"""Coverage of every joint's range by a selection, and poses that fill its gaps.

D-optimal poses gather at the ends of the joints. Errors that the model lacks (periodic errors, encoder scale, backlash
beyond a sign of the torque) are detected only where a joint has been. The range of every joint is therefore cut into
equal bins, and each bin that some candidate reaches must contain a pose.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

BINS = 8

Mask = NDArray[np.bool_]


def cells_of(joints: Array, bins: int = BINS) -> Mask:
    """Mark the bin of its range in which each joint of each candidate lies, shape (N, J, bins).

    The range of a joint (N, J) is from the lowest to the highest of all candidates.
    """
    low, high = joints.min(axis=0), joints.max(axis=0)
    share = (joints - low) / np.where(high > low, high - low, 1.0)
    number = np.minimum((share * bins).astype(np.int64), bins - 1)
    return number[:, :, None] == np.arange(bins)


def missing(cells: Mask, selection: Sequence[int] | NDArray[np.int64]) -> Mask:
    """Mark the bins (J, bins) that candidates reach but no selected pose does.

    The cells (N, J, bins) are those of all candidates.
    """
    visited = cells[np.asarray(selection, dtype=np.int64)]
    return np.logical_and(np.any(cells, axis=0), np.logical_not(np.any(visited, axis=0)))


def filling(cells: Mask, wanted: Mask, most: int, merit: Array) -> list[int]:
    """Choose at most `most` candidates that together fill the missing cells (J, bins).

    The one that fills most comes first, and among equals the one of higher merit (N,). Some cells stay empty if `most`
    is too small.
    """
    wanted = wanted.copy()
    chosen: list[int] = []
    while wanted.any() and len(chosen) < most:
        fills = (cells & wanted).sum(axis=(1, 2))
        equal = np.flatnonzero(fills == fills.max())
        chosen.append(int(equal[np.argmax(merit[equal])]))
        wanted &= ~cells[chosen[-1]]
    return chosen
