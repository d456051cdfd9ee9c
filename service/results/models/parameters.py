"""The parameters of an identified model as rows: change from nominal, standard error, what was dropped and why."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.fit import Identification
from calib.model import RobotModel
from calib.units import to_display


@dataclass(frozen=True)
class Row:
    """One parameter, in the unit it is shown in. `change` and `std` are None where it was dropped."""

    name: str
    effect: str
    owner: str
    unit: str
    nominal: float | None  # None where the robot file says nothing about it
    change: float | None
    std: float | None
    confounded_with: tuple[str, ...]

    @property
    def value(self) -> float | None:
        """Nominal plus change; the change alone where there is no nominal value."""
        return None if self.change is None else (self.nominal or 0.0) + self.change


def rows_of(found: Identification, *, base_model_only: bool = False) -> list[Row]:
    """Every parameter of a model in order; without those of diagnosed effects on request."""
    dropped = {drop.name: drop.confounded_with for drop in found.dropped}
    errors = found.standard_errors
    rows = []
    for effect in found.model.effects:
        if base_model_only and effect.group != "base model":
            continue
        for parameter in effect.parameters:
            position = found.model.index[parameter.name]
            live = parameter.name not in dropped
            rows.append(
                Row(
                    name=parameter.name,
                    effect=effect.label,
                    owner=effect.owner,
                    unit=parameter.unit,
                    nominal=_nominal(found.model, parameter.name),
                    change=to_display(float(found.estimate[position]), parameter.unit) if live else None,
                    std=to_display(float(errors[position]), parameter.unit) if live else None,
                    confounded_with=dropped.get(parameter.name, ()),
                )
            )
    return rows


_STRONG = 0.9
_HIGH = 3.0  # times the mean


def strong_correlations(found: Identification) -> list[tuple[str, str, float]]:
    """Pairs of parameters that the readings hardly distinguish, |r| above 0.9, strongest first."""
    correlations = np.nan_to_num(np.triu(found.correlations, k=1))
    pairs = np.argwhere(np.abs(correlations) > _STRONG)
    names = [p.name for p in found.model.parameters]
    strong = [(names[i], names[j], float(correlations[i, j])) for i, j in pairs]
    return sorted(strong, key=lambda pair: -abs(pair[2]))


def high_leverage(found: Identification) -> list[tuple[int, float]]:
    """Rows of the data set (index, hat value) on which the fit leans more than three times as on others."""
    leverage = found.leverage
    high = np.flatnonzero(leverage > _HIGH * leverage.mean())
    order = high[np.argsort(-leverage[high])]
    return [(int(found.readings.rows[i]), float(leverage[i])) for i in order]


def _nominal(model: RobotModel, name: str) -> float | None:
    robot = model.robot
    kind, number = name.rstrip("0123456789"), name[len(name.rstrip("0123456789")) :]
    if not number:
        return None
    link = int(number) - 1
    if kind in ("alpha", "theta"):
        return to_display(getattr(robot, kind)[link], "deg")
    if kind in ("a", "d"):
        return getattr(robot, kind)[link]
    return 0.0 if kind in ("beta", "c") else None
