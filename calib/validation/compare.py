"""Two calibrations of one robot side by side, such as one by laser tracker and one by camera.

Parameters of the robot with their uncertainties, and for each

    E_n = |a - b| / (2 sqrt(u_a^2 + u_b^2)),

above 1 where the two differ by more than their expanded uncertainties (k = 2) allow. Both robots are then placed on
the same readings and judged by the same others, and the distance between their predictions is reported: parameters may
differ where predictions agree, since readings hold only some combinations of them. Sources: Nubiola, thesis, section
2.6 (the comparison); ISO 13528 (E_n).
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
    """A parameter of the robot in both calibrations, in `unit`; None where a calibration lacks or dropped it."""

    name: str
    unit: str
    first: float | None
    second: float | None
    u_first: float | None  # standard uncertainties
    u_second: float | None

    @property
    def difference(self) -> float | None:
        """The second value less the first."""
        return None if self.first is None or self.second is None else self.second - self.first

    @property
    def e_n(self) -> float | None:
        """Normalised error; None where one of the two calibrations says nothing."""
        if self.difference is None or self.u_first is None or self.u_second is None:
            return None
        return abs(self.difference) / (_COVERAGE * math.hypot(self.u_first, self.u_second))


def refuse_incomparable(first: CalibratedModel, second: CalibratedModel, file: Path) -> None:
    """Raise DataError, for the file of the second, unless both start from the same nominal robot."""
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
    """Every parameter of the robot in one of the two models, without carried terms, in the order of the first."""
    units = {p.name: p.unit for saved in (first, second) for p in _robot_parameters(saved.model)}
    out = []
    for name, unit in units.items():
        (a, u_a), (b, u_b) = _of(first, name, unit), _of(second, name, unit)
        out.append(Difference(name, unit, a, b, u_a, u_b))
    return out


Placed = tuple[ModelStructure, Array]
"""A model and its estimate, as `place` gives them."""


def apart(dataset: Dataset, rows: NDArray[np.bool_], first: Placed, second: Placed) -> Summary | None:
    """Distance between two predictions over some rows (mask), mm; both robots placed on the same readings before."""
    conditions = dataset.conditions.take(rows)
    one, other = (BoundModel(model, conditions).predict(estimate) for model, estimate in (first, second))
    return summarise(distances(one, other))


def _robot_parameters(model: ModelStructure) -> Iterator[Parameter]:
    named = (e for e in model.effects if e.owner == "robot" and not e.is_carried)
    return (p for effect in named for p in effect.parameters)


def _of(saved: CalibratedModel, name: str, unit: str) -> tuple[float | None, float | None]:
    """Value and standard uncertainty; None for a parameter that the model lacks, or dropped (its variance is 0)."""
    position = saved.model.index.get(name)
    if position is None or saved.covariance[position, position] <= 0.0:
        return None, None
    spread = math.sqrt(float(saved.covariance[position, position]))
    return to_display(float(saved.estimate[position]), unit), to_display(spread, unit)
