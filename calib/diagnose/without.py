"""The value of each effect on held-out readings: the error without it and with it.

Without it, all other parameters take what they can of it: the fit is repeated to first order, which its covariance
allows. With x the estimate, C its covariance and e the effect's parameters, x - C_e C_ee^-1 x_e is the estimate under
the condition that the effect is zero.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit.held_out import errors_by
from calib.fit.identification import Identification
from calib.fit.statistics import ErrorStatistics, statistics_of
from calib.model.effect import Effect
from calib.model.model import Design


def estimate_without(found: Identification, effect: Effect) -> Array:
    """(m,) the estimate with one effect zero and all else adapted to first order."""
    positions = found.model.positions(effect)
    live = [i for i in positions if found.covariance[i, i] > 0.0]
    within = found.covariance[np.ix_(live, live)]
    estimate = found.estimate - found.covariance[:, live] @ np.linalg.solve(within, found.estimate[live])
    estimate[positions] = 0.0
    return estimate


def errors_without(
    dataset: Dataset, found: Identification, effects: Sequence[Effect]
) -> list[ErrorStatistics | None]:
    """Position error on validation rows without each of some effects; None where nothing was held out."""
    rows = dataset.validation_rows
    if not rows.any():
        return [None] * len(effects)
    design = Design(found.model, dataset.conditions.take(rows))
    return [
        statistics_of(errors_by(design, dataset, rows, estimate_without(found, effect))) for effect in effects
    ]
