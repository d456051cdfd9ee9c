"""Test whether the instrument has moved, from nests measured again during a watch.

Two readings of a nest differ by noise with twice its covariance. With s^2 along its worst direction the square of the
difference over 2 s^2 is at most chi-squared with 3 degrees of freedom. The rate holds for all nests together
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
    """Limit for nests that are measured twice.

    Attributes
    ----------
    limit_mm : float
        Difference that a nest may have, mm.
    seen_mm : float
        Shift of the instrument, mm, that exceeds the limit with the requested probability.
    """

    limit_mm: float
    seen_mm: float


def nest_limit(
    nests: Mapping[str, tuple[float, float, float]], noise: Noise, rate: float, chance: float = 0.95
) -> NestLimit:
    """Compute the limit for nests that an instrument measures twice.

    Parameters
    ----------
    nests : mapping of name to (x, y, z)
        Positions of the nests, mm.
    rate : float
        False-alarm rate for all nests together.
    chance : float, optional
        Probability with which a shift of `NestLimit.seen_mm` is detected.

    Raises
    ------
    DataError
        There are no nests, or the instrument has no declared noise.
    """
    if not nests:
        raise DataError("are empty.", do="Give the positions of the nests.", key="nests")
    places = np.array(list(nests.values()))
    covariance = noise.of_points(places, np.full(places.shape, np.nan))
    spread = float(np.sqrt(2.0 * np.linalg.eigvalsh(covariance).max()))
    if spread == 0.0:
        raise DataError(
            "is 0, so that chance errors are unknown.", do="Declare the instrument's noise.", key="noise"
        )
    limit = float(stats.chi2.isf(rate / len(nests), 3))
    return NestLimit(
        spread * float(np.sqrt(limit)), spread * float(np.sqrt(chndtrinc(limit, 3, 1.0 - chance)))
    )
