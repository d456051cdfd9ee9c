"""Statistics of position errors: n, RMS, mean, 95 % quantile and maximum of distances in mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array


@dataclass(frozen=True)
class ErrorStatistics:
    """Statistics of n distances, mm."""

    n: int
    rms: float
    mean: float
    p95: float
    max: float


def distances(predicted: Array, measured: Array) -> Array:
    """(n,) distances between points (n, 3), mm."""
    return np.linalg.norm(predicted - measured, axis=1)


def statistics_of(errors: Array) -> ErrorStatistics | None:
    """Statistics of errors (n,), mm; None where there are none."""
    if not len(errors):
        return None
    return ErrorStatistics(
        n=len(errors),
        rms=float(np.sqrt(np.mean(errors**2))),
        mean=float(np.mean(errors)),
        p95=float(np.quantile(errors, 0.95)),
        max=float(np.max(errors)),
    )
