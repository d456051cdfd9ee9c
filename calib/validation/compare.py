"""Comparison of two calibrations of one robot, such as by laser tracker and by camera.

The parameters of the robot are compared with their uncertainties by

    E_n = |a - b| / (2 sqrt(u_a^2 + u_b^2)),

which is above 1 if the difference exceeds the expanded uncertainties (k = 2). Both robots are then placed on the same
readings and judged by the same other readings, and the distance between their predictions is reported. Parameters may
differ although predictions agree, since readings determine only some combinations of them. Sources: Nubiola, thesis,
section 2.6 (the comparison), and ISO 13528 (E_n).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.fit.statistics import distances
from calib.model.effect import Parameter
from calib.model.model import BoundModel, ModelStructure
from calib.saved.model_file import CalibratedModel
from calib.units import to_display
from calib.validation.summary import Summary, summarise

_COVERAGE = 2.0


@dataclass(frozen=True)
class Difference:
    """Parameter of the robot in both calibrations, in `unit`.

    Values are None for a calibration that lacks or dropped the parameter.
    """

    name: str
    unit: str
    first: float | None
    second: float | None
    u_first: float | None  # standard uncertainties
    u_second: float | None

    @property
    def difference(self) -> float | None:
        """Second value less the first."""
        return None if self.first is None or self.second is None else self.second - self.first

    @property
    def e_n(self) -> float | None:
        """Normalised error; None if one of the two calibrations has no value."""
        if self.difference is None or self.u_first is None or self.u_second is None:
            return None
        return abs(self.difference) / (_COVERAGE * math.hypot(self.u_first, self.u_second))


def refuse_incomparable(first: CalibratedModel, second: CalibratedModel, file: Path) -> None:
    """Refuse two models that do not start from the same nominal robot.

    Raises
    ------
    DataError
        The robots differ; the message names the file of the second.
    """
    a, b = first.model.robot, second.model.robot
    if a.name != b.name:
        raise DataError(
            f"is a model of the robot '{b.name}', not '{a.name}'.",
            do="Compare two calibrations of one robot.",
            file=file,
            key="robot",
        )
    if a != b:
        names = [
            name
            for name in ("convention", "base", "alpha", "a", "theta", "d")
            if getattr(a, name) != getattr(b, name)
        ]
        raise DataError(
            f"counts from another nominal robot: {', '.join(names) or 'limits, loads or joint matrices'} differ.",
            do="Identify both with the same robot file.",
            file=file,
            key="robot_table",
        )


def differences(first: CalibratedModel, second: CalibratedModel) -> list[Difference]:
    """List every parameter of the robot in at least one of two models.

    Carried terms are left out. The order is that of the first model.
    """
    units = {p.name: p.unit for saved in (first, second) for p in _robot_parameters(saved.model)}
    out = []
    for name, unit in units.items():
        (a, u_a), (b, u_b) = _of(first, name, unit), _of(second, name, unit)
        out.append(Difference(name, unit, a, b, u_a, u_b))
    return out


Placed = tuple[ModelStructure, Array]
"""A model and its estimate, as `place` gives them."""


def apart(dataset: Dataset, rows: NDArray[np.bool_], first: Placed, second: Placed) -> Summary | None:
    """Compute the distance between two predictions over some rows (mask), mm.

    Both robots must have been placed on the same readings.
    """
    conditions = dataset.conditions.take(rows)
    one, other = (BoundModel(model, conditions).predict(estimate) for model, estimate in (first, second))
    return summarise(distances(one, other))


def _robot_parameters(model: ModelStructure) -> Iterator[Parameter]:
    named = (e for e in model.effects if e.owner == "robot" and not e.is_carried)
    return (p for effect in named for p in effect.parameters)


def _of(saved: CalibratedModel, name: str, unit: str) -> tuple[float | None, float | None]:
    """Return value and standard uncertainty of a parameter, or None for both.

    They are None for a parameter that the model lacks or dropped (its variance is 0).
    """
    position = saved.model.index.get(name)
    if position is None or saved.covariance[position, position] <= 0.0:
        return None, None
    spread = math.sqrt(float(saved.covariance[position, position]))
    return to_display(float(saved.estimate[position]), unit), to_display(spread, unit)
