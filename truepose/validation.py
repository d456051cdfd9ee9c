"""A model judged in Python on readings that took no part in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.fit import base_model_of, place_nominal
from calib.model import named_only
from calib.units import DEG
from calib.validation import Judgement, judge, place, refuse_other_robot
from truepose.arguments import refuse_no_model
from truepose.data import Data, data_of
from truepose.frames import frame_of_rows
from truepose.model import Model

if TYPE_CHECKING:
    import pandas

_FIGURES = ("n", "mean", "std", "rms", "p95", "max")


@dataclass(frozen=True)
class Validation:
    """Judgements on the same readings: the nominal robot, placed, the model, and the model without carried terms if it
    holds any.

    >>> judged = truepose.validate(truepose.identify("irb120.csv"), "irb120.csv")
    >>> judged.errors.loc["model", ["n", "unit", "rms"]].to_dict()
    {'n': 40.0, 'unit': 'mm', 'rms': 0.272...}
    """

    judgements: tuple[Judgement, ...]

    def __repr__(self) -> str:
        nominal, judged = (each.error for each in self.judgements[:2])
        return f"<{judged.n} readings: {nominal.rms:.4f} mm RMS nominal, {judged.rms:.4f} mm with the model>"

    def _repr_html_(self) -> str:
        return self.errors.to_html(float_format=lambda x: f"{x:.4g}")

    @property
    def errors(self) -> pandas.DataFrame:
        """One row a model and quantity: position mm, length mm, orientation deg; n, mean, std, rms, p95, max."""
        rows: list[dict[str, Any]] = []
        for each in self.judgements:
            of = {"position": (each.position, "mm", 1.0), "length": (each.length, "mm", 1.0)}
            of["orientation"] = (each.orientation, "deg", DEG)
            for quantity, (summary, unit, size) in of.items():
                if summary is not None:
                    own = {k: getattr(summary, k) / (1.0 if k == "n" else size) for k in _FIGURES}
                    rows.append({"model": each.name, "quantity": quantity, "unit": unit, **own})
        return frame_of_rows(rows, ("quantity", "unit", *_FIGURES), "model")


def validate(
    model: Model, data: Data | str | Path, *, place_it: bool = False, everything: bool = False
) -> Validation:
    """Judge a model on the validation rows of a data set, or on `everything` that was measured.

    place_it: fit base, and tool where the model frees it, to the calibration rows first, for readings in another
    frame. Where there are no calibration rows, the rows that are judged place it and the nominal robot, which flatters.
    Raises DataError.

    >>> truepose.validate(truepose.identify("irb120.csv"), "irb120.csv")
    <40 readings: 1.3346 mm RMS nominal, 0.2724 mm with the model>
    """
    refuse_no_model(model, Model)
    dataset = data_of(data).dataset
    refuse_other_robot(model.saved, dataset, Path("the model"))
    dataset = model.saved.loaded(dataset)
    rows = dataset.usable if everything else dataset.validation_rows
    saved = model.saved
    own = {"model": (saved.model, saved.estimate)}
    if any(effect.is_carried for effect in saved.model.effects):
        own["model, named causes only"] = named_only(saved.model, saved.estimate, saved.covariance)[:2]
    names: dict[str, tuple[Any, np.ndarray]] = {
        "nominal robot, placed": place_nominal(dataset.placing, base_model_of(dataset.placing))
    }
    names |= {name: place(dataset.placing, *each) if place_it else each for name, each in own.items()}
    return Validation(tuple(judge(name, dataset, rows, *each) for name, each in names.items()))
