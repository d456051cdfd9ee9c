"""The test that the instrument is where it was: three nests measured twice, judged by the noise they must have.

Each nest moved by d_i between the two; a reading has the instrument's declared covariance S_i, and seating the
SMR anew adds u^2 I. If nothing moved,

    T = sum_i d_i^T [2 (S_i + u^2 I)]^-1 d_i

is chi-squared with 3 degrees of freedom a nest. Beyond its `FALSE_ALARM` quantile the instrument has a new
station and the world frame is made anew; up to it the old one stays, so that noise alone does not move it.
Source: the usual test for a change with known covariance (Johnson & Wichern, ch. 5).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from acquisition.cell.cell import NoiseFigures
from calib.data import Noise

SEAT_MM = 0.005  # centring and seat of an SMR in its nest; makers state 2.5 to 12 um for the centring
FALSE_ALARM = 1e-3


def moved_by(
    before_mm: Mapping[str, Sequence[float]], now_mm: Mapping[str, Sequence[float]], noise: NoiseFigures
) -> tuple[float, float] | None:
    """Distance, mm, by which nests of the same names, both in the instrument's frame, are off (the largest), and T in
    units of its limit. None within the noise: beyond it they or the instrument moved, and a drift counts as a move."""
    names = list(before_mm)
    before = np.array([before_mm[name] for name in names], dtype=np.float64)
    moved = np.array([now_mm[name] for name in names], dtype=np.float64) - before
    each = covariance_of(before, noise)
    distance = float(np.einsum("ni,nij,nj->", moved, np.linalg.inv(2.0 * each), moved))
    limit = float(chdtri(3 * len(names), FALSE_ALARM))
    return (float(np.linalg.norm(moved, axis=1).max()), distance / limit) if distance > limit else None


def covariance_of(points: NDArray[np.float64], noise: NoiseFigures) -> NDArray[np.float64]:
    """(n, 3, 3) mm2: of nests (n, 3) in the instrument's frame, read once, the SMR seated anew."""
    tracker = Noise(
        "tracker",
        range_mm=noise.range_mm,
        range_ppm=noise.range_ppm,
        transverse_mm=noise.transverse_mm,
        transverse_ppm=noise.transverse_ppm,
    )
    return tracker.of_points(points, np.full_like(points, np.nan)) + SEAT_MM**2 * np.eye(3)
