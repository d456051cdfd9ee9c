"""Nests measured again during a watch: the test whether the instrument has moved since.

Two readings of a nest differ by noise with twice its covariance. With s^2 along its worst direction the square of the
difference over 2 s^2 is at most chi-squared with 3 degrees of freedom; the rate holds for all nests together
(Bonferroni).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from scipy import stats
from scipy.special import chndtrinc

from calib.data.noise import Noise
from calib.errors import DataError


@dataclass(frozen=True)
class NestLimit:
    """limit_mm: by which a nest may differ; seen_mm: the shift of the instrument that exceeds it in 95 of 100."""

    limit_mm: float
    seen_mm: float


def nest_limit(
    nests: Mapping[str, tuple[float, float, float]], noise: Noise, rate: float, chance: float = 0.95
) -> NestLimit:
    """The limit for nests, mm, that an instrument of some noise measures twice. Raises DataError without nests, or
    noise."""
    if not nests:
        raise DataError("are none.", do="Name the places of the nests.", key="nests")
    places = np.array(list(nests.values()))
    covariance = noise.of_points(places, np.full(places.shape, np.nan))
    spread = float(np.sqrt(2.0 * np.linalg.eigvalsh(covariance).max()))
    if spread == 0.0:
        raise DataError(
            "is 0: nothing says what is chance.", do="Declare the instrument's noise.", key="noise"
        )
    limit = float(stats.chi2.isf(rate / len(nests), 3))
    return NestLimit(
        spread * float(np.sqrt(limit)), spread * float(np.sqrt(chndtrinc(limit, 3, 1.0 - chance)))
    )
