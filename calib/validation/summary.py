"""Statistics of errors as in calibration papers and standards.

They are mean, standard deviation, mean + 3 s and RMS. The JSON of `diagnose` uses the shorter
`calib.fit.statistics.ErrorStatistics`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from calib.array import Array


@dataclass(frozen=True)
class Summary:
    """Statistics of n errors, all zero or above, in the unit of the errors.

    Attributes
    ----------
    std : float
        Standard deviation with n - 1; NaN for a single error.
    p95 : float
        95 % of the errors are at most this value.
    """

    n: int
    mean: float
    std: float
    rms: float
    p95: float
    max: float

    @property
    def mean_3std(self) -> float:
        """Mean + 3 s."""
        return self.mean + 3.0 * self.std


def summarise(errors: Array) -> Summary | None:
    """Summarise errors (n,); None without errors."""
    if not len(errors):
        return None
    return Summary(
        n=len(errors),
        mean=float(np.mean(errors)),
        std=float(np.std(errors, ddof=1)) if len(errors) > 1 else math.nan,
        rms=float(np.sqrt(np.mean(errors**2))),
        p95=float(np.quantile(errors, 0.95)),
        max=float(np.max(errors)),
    )
