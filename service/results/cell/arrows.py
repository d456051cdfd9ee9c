"""Errors of readings as arrows in space, for the nominal robot in its place and for a model.

An error is the measured minus the predicted point. Lengths are in mm, in the world frame.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from calib.data import Dataset
from calib.fit import IdentificationFit, base_model_of, place_nominal
from calib.model import BoundModel
from service.json_values import finite

FORMAT = "truepose-arrows/1"
MOST = 500  # more could not be distinguished


def arrows_of(dataset: Dataset, found: IdentificationFit) -> dict[str, Any]:
    """Create the arrows of the held-out readings, or of the fitted ones if none were held out.

    Only readings of points count. At most `MOST` are drawn; `readings` states from how many.
    """
    held = dataset.validation_rows & dataset.pointed
    rows = held if held.any() else dataset.fit_rows & dataset.pointed
    shown = np.flatnonzero(rows)
    if len(shown) > MOST:
        shown = np.sort(np.random.default_rng(0).choice(shown, MOST, replace=False))
    document: dict[str, Any] = {
        "format": FORMAT,
        "held_out": bool(held.any()),
        "readings": int(rows.sum()),
        "arrows": [],
    }
    if len(shown):
        taken = np.isin(np.arange(len(dataset)), shown)
        conditions, points = dataset.conditions.take(taken), dataset.points[taken]
        nominal, placed = place_nominal(dataset, base_model_of(dataset, None))
        before, after = (
            points - BoundModel(nominal, conditions).predict(placed),
            points - found.predict(conditions),
        )
        document["arrows"] = [
            {
                "reading": dataset.reading_id[i],
                "at_mm": np.round(at, 1).tolist(),
                "nominal_mm": np.round(one, 5).tolist(),
                "model_mm": np.round(other, 5).tolist(),
            }
            for i, at, one, other in zip(shown.tolist(), points, before, after, strict=True)
        ]
    return finite(document)
