"""A model of one robot in Python: identified from readings, or loaded from its file."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from calib.array import Array
from calib.data import LEVELS
from calib.diagnose import DiagnosisFit as Findings
from calib.errors import DataError
from calib.fit import IdentificationFit, errors_on, silent, statistics_of
from calib.fit import identify as fit
from calib.model import FLANGE, BoundModel, StatedConditions, conditions_at, series_of
from calib.prior import load_prior
from calib.saved import CalibratedModel, as_saved, load_model, save_model
from calib.units import to_display
from service.results.models.parameters import absolutes, nominals
from truepose.arguments import joints_of, number_of, refuse_other_level
from truepose.data import Data, data_of
from truepose.frames import frame

if TYPE_CHECKING:
    import pandas
    from matplotlib.figure import Figure

Progress = Callable[[str], None]
COLD_TO_HOT_C = (-50.0, 100.0)  # of the air about a robot; beyond it another unit is meant
LONG_S = 1e9  # thirty years


@dataclass(frozen=True)
class Model:
    """An identified robot.

    `saved` is the content of its file. `fitted` is the fit, None for a model that was loaded.

    >>> model = truepose.identify("irb120.csv")
    >>> model.parameters.round(2).loc["base.x", ["value", "std", "unit"]].to_dict()
    {'value': 0.46, 'std': 0.02, 'unit': 'mm'}
    >>> model.predict(joints_deg=[[10, 20, -30, 40, 50, 60]], target="T1").round(1)  # mm
    array([[498.7, 187.9, 572.5]])
    >>> round(model.error_mm["rms"], 3)
    0.272
    """

    saved: CalibratedModel
    fitted: IdentificationFit | None = None
    data: Data | None = None
    findings: Findings | None = None

    def __repr__(self) -> str:
        model = self.saved.model
        found = [e.label for e in model.effects if e.group != "base model" and not e.is_carried]
        if carried := sum(e.is_carried for e in model.effects):
            found.append(f"{carried} carried term{'s' if carried > 1 else ''}")
        beside = f" with {', '.join(found)}" if found else ""
        return f"<model of {model.robot.name}{beside}: {len(model.parameters)} parameters>"

    def _repr_html_(self) -> str:
        return self.parameters.to_html(float_format=lambda x: f"{x:.5g}")

    @property
    def converged(self) -> bool:
        """Whether the fit ended where it should; one that was loaded did."""
        return self.fitted is None or self.fitted.converged

    @property
    def parameters(self) -> pandas.DataFrame:
        """Table of the parameters, one row each, by name.

        value and its standard error std are relative to the start of the fit (for a link, the change from nominal).
        Further columns are unit, effect and owner. Then come the absolute value, the nominal value from robot file or
        header, and the change from it. It is NaN without a nominal value; only a model that was fitted here knows the
        header. A
        parameter that the readings do not determine has the standard error 0 and the value 0.
        """
        saved = self.saved
        errors = np.sqrt(np.diag(saved.covariance))
        absolute = absolutes(saved.model, saved.estimate, saved.covariance)
        nominal = nominals(saved.model, None if self.fitted is None else self.fitted.header)
        owners = [
            (effect.label, effect.owner, p) for effect in saved.model.effects for p in effect.parameters
        ]
        return frame(
            {
                "value": [
                    to_display(float(v), p.unit) for v, (_, _, p) in zip(saved.estimate, owners, strict=True)
                ],
                "std": [to_display(float(e), p.unit) for e, (_, _, p) in zip(errors, owners, strict=True)],
                "unit": [p.unit for _, _, p in owners],
                "effect": [label for label, _, _ in owners],
                "owner": [owner for _, owner, _ in owners],
                "absolute": [absolute[p.name][0] for _, _, p in owners],
                "nominal": [nominal.get(p.name, math.nan) for _, _, p in owners],
                "change_from_nominal": [
                    absolute[p.name][0] - nominal.get(p.name, math.nan) for _, _, p in owners
                ],
            },
            [p.name for _, _, p in owners],
            "parameter",
        )

    @property
    def residuals(self) -> pandas.DataFrame:
        """Table of the residuals, one row per measured reading, by reading_id.

        Columns are set, error_mm, and measured less predicted dx, dy, dz_mm.

        Raises
        ------
        DataError
            The model was loaded, and has no readings. `validate` judges it on some.
        """
        data = self._data()
        of = data.dataset
        rows = of.usable
        design = BoundModel(self.saved.model, of.conditions.take(rows))
        apart = (
            of.points[rows]
            - np.broadcast_to(design.frames(self.saved.estimate, ()).p, (3, int(rows.sum()))).T
        )
        return frame(
            {
                "set": of.sets[rows],
                "error_mm": errors_on(of, rows, self.saved.model, self.saved.estimate),
                **{f"d{axis}_mm": apart[:, k] for k, axis in enumerate("xyz")},
            },
            [name for name, used in zip(of.reading_id, rows, strict=True) if used],
            "reading_id",
        )

    @property
    def error_mm(self) -> dict[str, float]:
        """n, rms, mean, p95 and max of the error on the validation rows, mm.

        It is empty without validation rows.
        """
        data = self._data()
        errors = errors_on(data.dataset, data.dataset.validation_rows, self.saved.model, self.saved.estimate)
        found = statistics_of(errors)
        return {} if found is None else {k: getattr(found, k) for k in ("n", "rms", "mean", "p95", "max")}

    def predict(
        self,
        *,
        joints_deg: Any,
        target: str = FLANGE,
        temperature_c: float | None = None,
        time_s: float | None = None,
        series: str | None = None,
    ) -> Array:
        """Predict points (n, 3) of a tool target, mm, in the frame of the readings.

        joints_deg are (n, N) as the controller counts.

        Raises
        ------
        DataError
            The shape is wrong, or the target or series is unknown.
        """
        joints = joints_of(joints_deg, self.saved)
        stated = self.stated(temperature_c=temperature_c, time_s=time_s, series=series)
        model = self.saved.model
        known = (FLANGE, *model.targets[series_of(model, stated)])
        if target not in known:
            raise DataError(
                f"'{target}' is not a target of the model.", do=f"Use {', '.join(known[1:])}.", key="target"
            )
        name = series_of(model, stated)
        targets = {**model.targets, name: {FLANGE: (0.0, 0.0, 0.0), **model.targets[name]}}
        design = BoundModel(replace(model, targets=targets), conditions_at(model, joints, stated, target))
        return np.array(np.broadcast_to(design.frames(self.saved.estimate, ()).p, (3, len(joints))).T)

    def stated(
        self,
        *,
        side: tuple[float, ...] | float = 1.0,
        temperature_c: float | None = None,
        time_s: float | None = None,
        series: str | None = None,
        approach_rad: float | None = None,
    ) -> StatedConditions:
        """Return conditions for a prediction or a correction.

        A condition that is None is that of the readings.

        Raises
        ------
        DataError
            A condition cannot be used.
        """
        names = tuple(self.saved.model.targets)
        if series not in names and (series is not None or len(names) > 1):
            raise DataError(
                "the model holds several series."
                if series is None
                else f"'{series}' is not a series of the model.",
                do=f"Use {', '.join(names)}.",
                key="series",
            )
        usual = self.saved.usual
        return replace(
            usual,
            side=side,
            temperature_c=number_of(temperature_c, usual.temperature_c, *COLD_TO_HOT_C, "temperature_c"),
            time_s=number_of(time_s, math.nan, -LONG_S, LONG_S, "time_s"),
            series=series,
            approach=usual.approach if approach_rad is None else approach_rad,
        )

    def save(self, path: str | Path, *, save_anyway: bool = False) -> Path:
        """Write the model file, which the command line and the service read.

        Raises
        ------
        OSError
            The file cannot be written.
        DataError
            The model was loaded, or is worse on held-out readings than the nominal robot. `save_anyway` allows the
            latter.
        """
        if self.fitted is None:
            raise DataError("the model was loaded from a file.", do="Copy that file.", key="save")
        save_model(Path(path), self.fitted, self.findings, save_anyway=save_anyway)
        return Path(path)

    def plot_residuals(self) -> Figure:
        """Draw the errors: one dot per reading in the order of measurement, and a histogram by set."""
        from truepose.pictures import residuals

        return residuals(self.residuals)

    def _data(self) -> Data:
        if self.data is None:
            raise DataError(
                "the model was loaded and knows no readings.",
                do="Judge it with truepose.validate(model, data).",
            )
        return self.data


def identify(
    data: Data | str | Path,
    *,
    level: int | None = None,
    prior: str | Path | None = None,
    progress: Progress | None = None,
) -> Model:
    """Identify the parameters of the base model, without any search for missing effects.

    Parameters
    ----------
    level :
        1 joints, 2 geometry, 3 and gravity, instead of the groups that the header frees (Roth, Mooring and Ravani
        1987).
    prior :
        File of the statistics of this robot type (`truepose fleet learn`).
    progress :
        Called with the text of each step.

    Raises
    ------
    DataError
        The data or an argument cannot be used.

    >>> truepose.identify("irb120.csv")
    <model of abb-irb120: 32 parameters>
    """
    of = data_of(data)
    refuse_other_level(level)
    groups = None if level is None else LEVELS[level]
    of_type = None if prior is None else load_prior(Path(prior))
    fitted = fit(of.dataset, groups=groups, prior=of_type, progress=progress or silent)
    return Model(as_saved(fitted), fitted, of)


def load(path: str | Path, *, robot: str | Path | None = None) -> Model:
    """Read a model from its file.

    `robot` is the robot's own file, which must agree with the model.

    Raises
    ------
    DataError
        The file cannot be used.

    >>> path = truepose.identify("irb120.csv").save("irb120.json")
    >>> truepose.load(path)
    <model of abb-irb120: 32 parameters>
    """
    return Model(load_model(Path(path), robot_file=None if robot is None else Path(robot)))
