"""A fit continued with another model, from its estimate and with its readings."""

from __future__ import annotations

import numpy as np

from calib.data.dataset import Dataset
from calib.fit.identification import IdentificationFit
from calib.fit.identify import fit_plain
from calib.model.model import ModelStructure


def fit_again(dataset: Dataset, fitted: IdentificationFit, model: ModelStructure) -> IdentificationFit:
    """Fit another model to the readings of a fit, from its estimate.

    The model has the same parameters. Readings that took no part still take none.
    """
    return fit_plain(
        dataset,
        model,
        fitted.readings,
        fitted.estimate,
        np.diag(fitted.covariance) > 0.0,
        fitted.dropped,
        fitted.faulty_rows,
        fitted.relabelled_rows,
    )
