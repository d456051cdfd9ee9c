"""The baseline as a watch uses it: what it says of readings that were taken after all that its campaign saw."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.model.model import RobotModel
from calib.model.regressors import Time, WarmUp
from calib.model.stated import AFTER_EVERYTHING
from calib.saved import SavedModel


def in_series(model: RobotModel, dataset: Dataset) -> Dataset:
    """The readings in the one series of a model, whatever both call it, after all that the model says happened during
    the calibration."""
    conditions = dataset.conditions
    conditions = replace(
        conditions,
        series_names=(next(iter(model.targets)),),
        order=np.full(len(conditions), AFTER_EVERYTHING),
    )
    return replace(dataset, conditions=conditions)


def without_drifts(saved: SavedModel) -> tuple[Array, Array]:
    """Estimate (m,) and covariance (m, m) without what the instrument did with time in its own campaign."""
    model = saved.model
    gone = {
        term.parameter
        for effect in model.effects
        if effect.owner == "instrument"
        for term in effect.terms
        if isinstance(term.regressor, Time | WarmUp)
    }
    kept = np.array([p.name not in gone for p in model.parameters], dtype=float)
    return saved.estimate * kept, saved.covariance * np.outer(kept, kept)
