"""Statistics of position errors: n, RMS, mean, 95 % quantile and maximum of distances in mm."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array

_WORSE, _LEAST_MM = 0.02, 1e-3


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


def worse(found: ErrorStatistics | None, nominal: ErrorStatistics | None) -> bool:
    """Whether the error of a model exceeds that of the nominal robot in its place by more than 2 % and a micrometre;
    False if nothing was held out."""
    if found is None or nominal is None:
        return False
    return found.rms > (1.0 + _WORSE) * nominal.rms + _LEAST_MM
