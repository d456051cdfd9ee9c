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
    """Compute the distances between points (n, 3), mm, shape (n,)."""
    return np.linalg.norm(predicted - measured, axis=1)


def statistics_of(errors: Array) -> ErrorStatistics | None:
    """Compute the statistics of errors (n,), mm; return None if there are no errors."""
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
    """Test whether a model has larger errors than the nominal robot in its place.

    The RMS error must exceed it by more than 2 % and a micrometre. The result is False if nothing was
    held out.
    """
    if found is None or nominal is None:
        return False
    return found.rms > (1.0 + _WORSE) * nominal.rms + _LEAST_MM
