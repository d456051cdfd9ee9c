"""The correlation of the speeds of two streams, by the lag between them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

SURE = 0.9
"""A likeness from which on two stretches show the same moves."""
_ROUNDING = 1e-9  # of the transform, as a share of the largest sum of squares


@dataclass(frozen=True)
class Speeds:
    """Speeds of one stream at equal steps of its own clock from `begin`, s: speed (m,) mm/s, 0 where not seen (m,)."""

    begin: float
    step: float
    speed: Array
    seen: NDArray[np.bool_]


def likeness(robot: Speeds, tracker: Speeds) -> tuple[NDArray[np.int64], Array, Array]:
    """Correlation of the two series by lag.

    Lags (l,) in steps by which the tracker's series begins later in the robot's; the correlation (l,) of what both have
    seen there; and how many steps (l,) that are: a third of the shorter series, or they count as unlike.
    """
    count = len(robot.speed) + len(tracker.speed) - 1
    size = 1 << (count - 1).bit_length()
    one, two = (
        np.fft.rfft([s.seen * 1.0, s.speed * s.seen, s.speed**2 * s.seen], size) for s in (robot, tracker)
    )
    pairs = ((0, 0), (1, 0), (0, 1), (1, 1), (2, 0), (0, 2))  # powers of the two speeds in each sum
    sums = np.fft.irfft(np.stack([one[i] * np.conj(two[k]) for i, k in pairs]), size)
    both, a, b, ab, aa, bb = np.roll(sums, len(tracker.speed) - 1, axis=1)[:, :count]
    enough = both > min(robot.seen.sum(), tracker.seen.sum()) / 3.0
    n = np.maximum(both, 1.0)
    spread = np.maximum(aa - a * a / n, _ROUNDING * aa.max()) * np.maximum(
        bb - b * b / n, _ROUNDING * bb.max()
    )
    alike = np.where(enough & (spread > 0.0), (ab - a * b / n) / np.sqrt(np.maximum(spread, 1e-300)), -1.0)
    return np.arange(count) - (len(tracker.speed) - 1), alike, both


def peak(values: Array, best: int, lags: NDArray[np.int64]) -> float:
    """Place of the maximum between lags, by a parabola through three of them."""
    if not 0 < best < len(values) - 1:
        return float(lags[best])
    left, top, right = values[best - 1 : best + 2]
    curve = left - 2.0 * top + right
    return float(lags[best]) + (0.5 * (left - right) / curve if curve < 0.0 else 0.0)
