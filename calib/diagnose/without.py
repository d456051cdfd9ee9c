"""The value of each effect on held-out readings: the error without it and with it.

Without it, all other parameters take what they can of it: the fit is repeated to first order (`calib.model.reduced`).
"""

from __future__ import annotations

from collections.abc import Sequence

from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit.held_out import errors_by
from calib.fit.identification import Identification
from calib.fit.statistics import ErrorStatistics, statistics_of
from calib.model.effect import Effect
from calib.model.model import Design
from calib.model.reduced import conditional


def estimate_without(found: Identification, effect: Effect) -> Array:
    """(m,) the estimate with one effect zero and all else adapted to first order."""
    return conditional(found.model, found.estimate, found.covariance, (effect,))[0]


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
