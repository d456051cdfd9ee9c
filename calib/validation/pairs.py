"""Distance error over all pairs of points of the workspace.

    e_ij = | |m_i - m_j| - |p_i - p_j| |,  i < j,  measured m and predicted p

It needs no common frame, unlike the position error. n points make n (n - 1) / 2 pairs (9,905: 49,049,560), so they
are processed in square tiles and only sums are kept. Source: Nubiola, thesis 4.

Squared distances are computed from products, |x_i|^2 + |x_j|^2 - 2 x_i.x_j in float64 of centred points. With R the
farthest point, they are off by about 8 eps R^2. For R = 1 m that is 9e-10 mm in a distance of 1 mm, and 4e-5 mm in one
of zero. Pairs nearer than R/100 are therefore computed again by differences. The remaining error is below 1e-13 R.

For the 95 % quantile, a sample of the points gives a bracket, and the errors in that bracket are counted in bins. If
the quantile is outside the bracket, or the bins are wider than `RESOLUTION`, the bracket is changed and the pairs are
processed again.
"""

from __future__ import annotations

import math
import os
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.distance import pdist

from calib.array import Array
from calib.validation.summary import Summary

RESOLUTION = 1e-4
"""To this share of itself the 95 % quantile is known, or to 1e-9 mm."""

TILE = 192
"""Rows and columns of a tile: two of them stay in a core's cache."""

_BINS = 4096
_SAMPLE = 900  # points; their pairs place the quantile to better than one per cent of all
_NEAR = 0.01  # of the farthest point's distance from the centre


def pair_errors(measured: Array, predicted: Array, *, tile: int = TILE) -> Summary | None:
    """Summarise the distance errors, mm, over all pairs of points (n, 3), mm.

    The result is None for fewer than two points. p95 is the order statistic of rank ceil(0.95 pairs), to `RESOLUTION`.
    It needs a few MB of memory for any n.
    """
    n = len(measured)
    if n < 2:
        return None
    sweep = _Sweep(measured, predicted, tile)
    pairs = n * (n - 1) // 2
    rank = math.ceil(0.95 * pairs)
    every = -(-n // _SAMPLE)
    sample = np.abs(pdist(measured[::every]) - pdist(predicted[::every]))
    bracket = _Bracket(0.0, sweep.bound)
    if len(sample):
        bracket = _Bracket(*np.quantile(sample, (0.94, 0.96)).tolist())
    while True:
        tally = sweep.over(bracket)
        found = bracket.around(rank - tally.below, tally.bins)
        if found is None:
            bracket = _Bracket(0.0, sweep.bound)
        elif bracket.width <= max(RESOLUTION * bracket.high, 1e-9):
            break
        else:
            bracket = found
    mean = tally.sum / pairs
    spread = max(tally.squares - pairs * mean**2, 0.0)
    return Summary(
        n=pairs,
        mean=mean,
        std=math.sqrt(spread / (pairs - 1)) if pairs > 1 else math.nan,
        rms=math.sqrt(tally.squares / pairs),
        p95=min(found.middle, tally.max),
        max=tally.max,
    )


class _Bracket(NamedTuple):
    """Interval that is searched for the quantile, in bins of equal width."""

    low: float
    high: float

    @property
    def width(self) -> float:
        return (self.high - self.low) / _BINS

    @property
    def middle(self) -> float:
        return (self.low + self.high) / 2.0

    def around(self, rank: int, bins: NDArray[np.int64]) -> _Bracket | None:
        """Return the bin that contains the error of this rank, with a neighbour on each side.

        The rank is among the errors inside the bracket; None if it is outside.
        """
        upto = np.cumsum(bins)
        if not 1 <= rank <= upto[-1]:
            return None
        k = int(np.searchsorted(upto, rank))
        return _Bracket(max(self.low + (k - 1) * self.width, 0.0), self.low + (k + 2) * self.width)


@dataclass
class _Tally:
    sum: float
    squares: float
    max: float
    below: int  # errors below the bracket
    bins: NDArray[np.int64]  # (_BINS + 1,) errors inside it


class _Sweep:
    """All pairs, tile by tile, with strips of tiles on as many threads as processors."""

    def __init__(self, measured: Array, predicted: Array, tile: int) -> None:
        self.tile = tile
        self.points = np.stack([points - points.mean(axis=0) for points in (measured, predicted)])
        apart = np.linalg.norm(self.points[0] - self.points[1], axis=1)
        # | |a| - |b| | <= |a - b|, here for the differences of two points each
        self.bound = 2.0 * float(apart.max()) * (1.0 + 1e-9) + 1e-9
        squares = np.sum(self.points**2, axis=2)
        # predicted nearer than this includes every pair that was measured nearer than R/100
        self.near = (_NEAR * math.sqrt(float(squares.max())) + self.bound) ** 2
        ones = np.ones_like(squares)
        self.left = np.concatenate([-2.0 * self.points, np.stack([squares, ones], axis=2)], axis=2)
        self.right = np.concatenate(
            [self.points.transpose(0, 2, 1), np.stack([ones, squares], axis=1)], axis=1
        )

    def over(self, bracket: _Bracket) -> _Tally:
        """Compute the sums of one pass over all pairs."""
        starts = range(0, self.points.shape[1], self.tile)
        with ThreadPoolExecutor(os.cpu_count()) as pool:
            strips = list(pool.map(lambda start: self._strip(start, bracket), starts))
        return _Tally(
            sum=math.fsum(strip.sum for strip in strips),
            squares=math.fsum(strip.squares for strip in strips),
            max=max(strip.max for strip in strips),
            below=sum(strip.below for strip in strips),
            bins=np.sum([strip.bins for strip in strips], axis=0),
        )

    def _strip(self, start: int, bracket: _Bracket) -> _Tally:
        """Process rows start .. start + tile with themselves and all rows after them."""
        total = _Tally(0.0, 0.0, 0.0, 0, np.zeros(_BINS + 1, dtype=np.int64))
        # Once per strip: allocating it for every tile costs more than the sums
        room = np.empty((2, self.tile * self.tile))
        inside = []
        for first in range(start, self.points.shape[1], self.tile):
            errors = self._tile(start, first, room)
            total.sum += float(errors.sum())
            # by rows: BLAS runs long products in its own threads, which compete with these
            total.squares += float(np.vecdot(errors, errors).sum())
            total.max = max(total.max, float(errors.max(initial=0.0)))
            reached = errors >= bracket.low
            total.below += errors.size - int(np.count_nonzero(reached))
            inside.append(errors[reached & (errors <= bracket.high)])
        per_width = 1.0 / bracket.width if bracket.width > 0.0 else 0.0
        number = (np.concatenate(inside) - bracket.low) * per_width
        total.bins = np.bincount(np.minimum(number, _BINS).astype(np.intp), minlength=_BINS + 1)
        return total

    def _tile(self, start: int, first: int, room: Array) -> Array:
        """Compute the errors of the pairs of one tile, 2-D."""
        left, right = self.left[:, start : start + self.tile], self.right[:, :, first : first + self.tile]
        k, m = left.shape[1], right.shape[2]
        squared = room[:, : k * m].reshape(2, k, m)
        np.matmul(left, right, out=squared)
        if squared[1].min() < self.near:
            i, j = np.nonzero(squared[1] < self.near)
            squared[:, i, j] = np.sum((self.points[:, start + i] - self.points[:, first + j]) ** 2, axis=2)
        np.sqrt(squared, out=squared)
        errors = np.subtract(squared[0], squared[1], out=squared[0])
        np.abs(errors, out=errors)
        # tiles on the diagonal contain every pair twice, and each point with itself
        return errors[np.triu_indices(k, 1)][None] if first == start else errors
