"""A model judged in Python on readings that took no part in it."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from calib.units import DEG
from service.results.judgement.acceptance import AcceptanceLimits, read_zones
from service.results.judgement.validation import (
    JudgementShown,
    LoadedModel,
    ValidationRequest,
    ValidationResult,
)
from service.results.judgement.validation import validate as judged
from truepose.arguments import refuse_no_model
from truepose.data import Data, data_of
from truepose.frames import frame_of_rows
from truepose.model import Model

if TYPE_CHECKING:
    import pandas

_FIGURES = ("n", "mean", "std", "rms", "p95", "max")
_QUANTITIES = {  # member -> its name, the unit in a frame, and the size of that
    "position_mm": ("position", "mm", 1.0),
    "length_mm": ("length", "mm", 1.0),
    "orientation_mrad": ("orientation", "deg", 1e3 * DEG),
}


@dataclass(frozen=True)
class Validation:
    """The errors of models on the same readings.

    Attributes
    ----------
    result :
        Everything that is reported, as `truepose validate --json` writes it.

    >>> judged = truepose.validate(truepose.identify("irb120.csv"), "irb120.csv")
    >>> judged.errors.loc["model", ["n", "unit", "rms"]].to_dict()
    {'n': 40, 'unit': 'mm', 'rms': 0.272...}
    """

    result: ValidationResult

    @property
    def judgements(self) -> list[JudgementShown]:
        """Judgements of all models on the readings.

        They are the nominal robot, placed, the model, a model it is compared with, and the model without carried
        terms if it holds any.
        """
        return self.result.judgements

    def __repr__(self) -> str:
        nominal, found = (each.error for each in self.judgements[:2])
        return f"<{found.n} readings: {nominal.rms:.4f} mm RMS nominal, {found.rms:.4f} mm with the model>"

    def _repr_html_(self) -> str:
        return self.errors.to_html(float_format=lambda x: f"{x:.4g}")

    @property
    def errors(self) -> pandas.DataFrame:
        """Table of errors, one row per model and quantity: n, mean, std, rms, p95, max.

        Quantities are position mm, length mm and orientation deg.
        """
        rows: list[dict[str, Any]] = []
        for each in self.judgements:
            for member, (quantity, unit, size) in _QUANTITIES.items():
                if (summary := getattr(each, member)) is not None:
                    figures = {name: getattr(summary, name) for name in _FIGURES}
                    own = {name: x if name == "n" or x is None else x / size for name, x in figures.items()}
                    rows.append({"model": each.model, "quantity": quantity, "unit": unit, **own})
        return frame_of_rows(rows, ("quantity", "unit", *_FIGURES), "model")


def validate(
    model: Model,
    data: Data | str | Path,
    *,
    place: bool = False,
    everything: bool = False,
    compare: Model | None = None,
    point: tuple[float, float, float] | None = None,
    accept_rms: float | None = None,
    accept_max: float | None = None,
    accept_zones: str | Path | None = None,
) -> Validation:
    """Judge a model on the validation rows of a data set.

    Parameters
    ----------
    place :
        Fit base, and tool if the model frees it, to the calibration rows first, for readings in another frame. Without
        calibration rows, the rows that are judged place the model and the nominal robot, which flatters. Distances
        place the balls, by half of the poses if all rows judge, also unasked if the model does not know them.
    everything :
        Judge on all measured rows.
    compare :
        Another calibration of the same robot; both are placed on these readings.
    point :
        Point of the world, mm: errors are also grouped by the distance from it.
    accept_rms, accept_max :
        Limits of the RMS error and of the largest error, mm; the verdict is `result.acceptance`.
    accept_zones :
        File of workspace zones, each with its own limits.

    Raises
    ------
    DataError
        The model is not of this robot, or the readings cannot judge it.

    >>> truepose.validate(truepose.identify("irb120.csv"), "irb120.csv")
    <40 readings: 1.3346 mm RMS nominal, 0.2724 mm with the model>
    """
    refuse_no_model(model, Model)
    if compare is not None:
        refuse_no_model(compare, Model, "compare")
    read = LoadedModel(
        model.saved,
        Path("model"),
        None if compare is None else compare.saved,
        None if compare is None else Path("compared"),
    )
    zones = () if accept_zones is None else read_zones(Path(accept_zones))
    limits = AcceptanceLimits.of(accept_rms, accept_max, zones)
    asked = ValidationRequest(place, everything, point, limits)
    return Validation(judged(data_of(data).dataset, read, asked).result)
