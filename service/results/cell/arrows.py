"""Errors of readings as arrows in space (`truepose-arrows/1`).

They are for the nominal robot in its place and for a model. An error is the measured minus the predicted point.
Lengths are in mm, in the world frame.
"""

from __future__ import annotations

from typing import Annotated, Self

import numpy as np

from calib.data import Dataset
from calib.fit import IdentificationFit, base_model_of, place_nominal
from calib.model import BoundModel
from service.results.cell.scene import Place
from service.results.shape import ResponseBody, told

MOST = 500  # more could not be distinguished


class ArrowShown(ResponseBody):
    """A reading with its error, measured less predicted."""

    reading: Annotated[str, told("Id of the reading in its data set.", "17")]
    at_mm: Place
    nominal_mm: Annotated[
        list[float], told("Its error by the nominal robot in its place, mm.", [0.4, -0.9, 0.3])
    ]
    model_mm: Annotated[list[float], told("Its error by the model found, mm.", [0.01, -0.02, 0.01])]


class ArrowsShown(ResponseBody):
    """Errors in space."""

    format: Annotated[str, told("Name of this format.", "truepose-arrows/1")]
    held_out: Annotated[bool, told("Whether nothing was fitted to these readings.", True)]
    readings: Annotated[int, told("The number of readings of which these are a draw.", 120)]
    arrows: Annotated[list[ArrowShown], told("At most 500 of them.", [])]

    @classmethod
    def of(cls, dataset: Dataset, found: IdentificationFit) -> Self:
        """Create the arrows of the held-out readings, or of the fitted ones if none were held out.

        Only readings of points count. At most `MOST` are drawn; `readings` states from how many.
        """
        held = dataset.validation_rows & dataset.pointed
        rows = held if held.any() else dataset.fit_rows & dataset.pointed
        shown = np.flatnonzero(rows)
        if len(shown) > MOST:
            shown = np.sort(np.random.default_rng(0).choice(shown, MOST, replace=False))
        arrows = list[ArrowShown]()
        if len(shown):
            taken = np.isin(np.arange(len(dataset)), shown)
            conditions, points = dataset.conditions.take(taken), dataset.points[taken]
            nominal, placed = place_nominal(dataset, base_model_of(dataset, None))
            before = points - BoundModel(nominal, conditions).predict(placed)
            after = points - found.predict(conditions)
            arrows = [
                ArrowShown(
                    reading=dataset.reading_id[i],
                    at_mm=np.round(at, 1).tolist(),
                    nominal_mm=np.round(one, 5).tolist(),
                    model_mm=np.round(other, 5).tolist(),
                )
                for i, at, one, other in zip(shown.tolist(), points, before, after, strict=True)
            ]
        return cls(
            format="truepose-arrows/1", held_out=bool(held.any()), readings=int(rows.sum()), arrows=arrows
        )
