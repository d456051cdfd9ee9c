"""Remarks on a fit: noise that was declared too large, what repeated readings show, and values that cannot be."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtr, chdtrc

from calib.array import Array
from calib.data.dataset import Dataset
from calib.diagnose.named import COVERAGE
from calib.fit.identification import Identification
from calib.model.base_model import COMPLIANCE
from calib.units import to_display

_RARE = 0.001  # chance of a remark on the noise without reason
_LARGE = 0.75  # ratio of found noise to declared below which the declared one is too large
_FAR = 0.1  # below it the identification warns of wrong units
_SURE = 3.0  # standard errors below zero that make a compliance negative
_FEWEST = 10  # repeats within visits by which the noise of the instrument is known


def remarks_of(dataset: Dataset, fitted: Identification) -> tuple[str, ...]:
    """Sentences on the noise of a fit and on its compliances."""
    return (*_declared(fitted), *_within_visits(dataset, fitted), *_negative(fitted))


def _declared(fitted: Identification) -> list[str]:
    scale, freedom = fitted.noise_scale, fitted.degrees_of_freedom
    if not _FAR < scale < _LARGE or chdtr(freedom, freedom * (scale / _LARGE) ** 2) > _RARE:
        return []
    return [
        f"The residuals are {scale:.2g} times the declared noise: [noise] in the header is too large. Uncertainties "
        "and the smallest detectable sizes count with the declared noise, so that they are too large as well."
    ]


def _within_visits(dataset: Dataset, fitted: Identification) -> list[str]:
    """What readings of one target during one rest of the robot show: the instrument's noise alone."""
    conditions, rows = fitted.readings.conditions, fitted.readings.rows
    rest = np.column_stack([conditions.visit, conditions.target, conditions.anchor, conditions.series])
    group = np.unique(rest, axis=0, return_inverse=True)[1].reshape(-1)
    noise = dataset.header.noise
    total, count, repeats = 0.0, 0, 0
    pointed, spanned = dataset.pointed[rows], dataset.spanned[rows]
    if pointed.any():
        points = dataset.points[rows][pointed]
        apart, spare = _apart(points, group[pointed])
        covariance = noise.of_points(points, dataset.u_point[rows][pointed])
        total += float(np.sum(apart * np.linalg.solve(covariance, apart[:, :, None])[:, :, 0]))
        count, repeats = count + 3 * spare, repeats + spare
    if spanned.any():
        apart, spare = _apart(dataset.lengths[rows][spanned, None], group[spanned])
        given = dataset.u_length[rows][spanned]
        total += float(np.sum((apart[:, 0] / np.where(np.isfinite(given), given, noise.length_mm)) ** 2))
        count, repeats = count + spare, repeats + spare
    if repeats < _FEWEST:
        return []
    ratio = math.sqrt(total / count)
    if chdtrc(count, total) < _RARE:
        means = "the instrument scatters more than declared"
    elif chdtr(count, total) < _RARE:
        means = "the instrument scatters less than declared"
    else:
        means = "as declared"
    return [
        f"{repeats} repeated readings within visits, during which the robot rested, scatter {ratio:.2g} times the "
        f"declared noise of the instrument: {means}. The repeatability of the robot does not show in them."
    ]


def _apart(values: Array, group: NDArray[np.int64]) -> tuple[Array, int]:
    """Values (n, c) less the mean of their group (n,), and the number of readings beyond one per group."""
    _, own, size = np.unique(group, return_inverse=True, return_counts=True)
    means = np.array([np.bincount(own, column) for column in values.T]).T / size[:, None]
    return values - means[own], len(values) - len(size)


def _negative(fitted: Identification) -> list[str]:
    """Compliances of the base model that are negative beyond their uncertainty."""
    found = []
    for p, value, std in zip(fitted.model.parameters, fitted.estimate, fitted.standard_errors, strict=True):
        if p.unit == COMPLIANCE and "." not in p.name and value + _SURE * std < 0.0 < std:
            shown, u = (to_display(float(x), p.unit) for x in (value, COVERAGE * std))
            found.append(
                f"The compliance {p.name} came out negative ({shown:.2g} ± {u:.1g} {p.unit}), which no joint can be: "
                "another effect is imitated by it. Check the masses and centres of the loads."
            )
    return found
