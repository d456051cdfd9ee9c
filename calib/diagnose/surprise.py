"""The held-out error compared with what noise and the uncertainty of the parameters let expect.

A held-out error above that of the fit says little by itself: of thirty readings a model with thirty parameters follows
half of the noise, and where the arm was never measured its predictions are vague. Both are in the covariance of what is
predicted. With the whitened residual r, columns J, the covariance C of the parameters and noise as large as the fit
found it, s,

    r' (I + J C J' / s^2)^-1 r / s^2

is a chi-square over the rows held out. What exceeds it is neither: the model does not hold there, or those readings are
faulty. It decides nothing and is only reported. Source: Rao 1973, 4a.7 (prediction); Woodbury 1950 (the inverse).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtrc

from calib.data.dataset import Dataset
from calib.fit.identification import Identification
from calib.fit.readings import linearised, readings_of

_CHANCE = 1e-3  # of a surprise that is none
_NOTICED = 1.1  # times what was expected that are worth a word


@dataclass(frozen=True)
class Surprise:
    """The ratio of the held-out error to its expectation, and its p-value."""

    times: float
    p_value: float

    @property
    def real(self) -> bool:
        """Whether it is significant, and large enough to be reported."""
        return self.p_value < _CHANCE and self.times > _NOTICED


def surprise_of(
    dataset: Dataset, found: Identification, faulty: NDArray[np.bool_] | None = None
) -> Surprise | None:
    """The surprise of the validation rows, which took no part in the model; None where nothing was held out.

    faulty: (n,) mask over the data set of rows that are left out, since they are no readings of what they say.
    """
    rows = dataset.validation_rows if faulty is None else dataset.validation_rows & ~faulty
    if not rows.any():
        return None
    readings = readings_of(dataset, rows, found.model, found.estimate)
    if readings.observed.count == 0:
        return None
    spread = np.sqrt(np.diag(found.covariance))
    known = spread > 0.0
    size, noise = spread[known], max(found.noise_scale, 1.0)
    gram, shared, square = np.zeros((len(size), len(size))), np.zeros(len(size)), 0.0
    for _, residual, columns in linearised(found.model, readings, found.estimate):
        scaled, left = columns[:, known] * (size / noise), residual.ravel() / noise
        gram += scaled.T @ scaled
        shared += scaled.T @ left
        square += float(left @ left)
    correlation = found.covariance[np.ix_(known, known)] / (size[:, None] * size)
    inner = np.linalg.solve(np.eye(len(size)) + gram @ correlation, shared)
    square -= float(shared @ correlation @ inner)
    count = readings.observed.count
    # Readings of one visit share where the robot came to rest: unless that is declared they are one try
    apart = 1.0
    if readings.observed.shared is None:
        apart = len(np.unique(readings.conditions.visit)) / len(readings.rows)
    return Surprise(math.sqrt(max(square, 0.0) / count), float(chdtrc(count * apart, square * apart)))
