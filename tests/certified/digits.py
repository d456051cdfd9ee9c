"""How many digits of the certified numbers the program gets: the log relative error of estimate and standard error.

The problems are pure least squares, so the model's priors are taken out; its parameters count from the nominal robot
in the nominal place, where the repeatability of the joints is whitened too. Source of the measure: NIST StRD.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from decimal import Decimal
from pathlib import Path

import numpy as np

from calib import Dataset, read_dataset
from calib.fit import base_model_of, readings_of
from calib.fit.ending import FitTermination
from calib.fit.least_squares import Linearisation, Solution, solve
from calib.model import BoundModel, ModelStructure
from calib.units import to_display

FOLDER = Path(__file__).parent
PROBLEMS = tuple(sorted(path.stem for path in FOLDER.glob("*.json")))
MOST = 15.0  # digits of a double
_NOTHING = Decimal("1e-10")  # a certified number below it is nought, and its error counts as it is


@dataclass(frozen=True)
class Digits:
    """Correct digits of every parameter by name, and of the sum of squares; the problem's condition number."""

    values: dict[str, float]
    errors: dict[str, float]
    sum_of_squares: float
    condition: float
    iterations: int
    converged: bool


def correct(found: float, certified: Decimal) -> float:
    """-log10 of the relative error, of the absolute one for a certified nought; at most the digits of a double."""
    error = abs(Decimal(found) - certified) / (abs(certified) if abs(certified) > _NOTHING else 1)
    return MOST if error == 0 else min(MOST, -math.log10(error))


def pure_model(data: Dataset) -> ModelStructure:
    """The model of a data set without priors, every parameter counting from the nominal value in the file."""
    model = base_model_of(data)
    effects = tuple(
        replace(e, parameters=tuple(replace(p, size=None) for p in e.parameters)) for e in model.effects
    )
    return replace(model, effects=effects, turns={})


def solved(name: str) -> tuple[ModelStructure, Solution]:
    """The program's least squares on a problem, from the nominal robot."""
    data = read_dataset(FOLDER / f"{name}.csv")
    model = pure_model(data)
    start = np.zeros(len(model.parameters))
    readings = readings_of(data, data.fit_rows, model, start)
    every = np.ones(len(start), dtype=bool)
    design = BoundModel(model, readings.conditions)
    return model, solve(Linearisation(design, readings.observed, start), every, tolerance=1e-9)


def count(name: str) -> Digits:
    """Correct digits of one problem. Raises KeyError when the model's parameters are not those certified."""
    table = json.loads((FOLDER / f"{name}.json").read_text("utf-8"))
    certified = table["parameters"]
    model, solution = solved(name)
    if set(certified) != set(model.index):
        raise KeyError(f"{name}: {sorted(set(certified) ^ set(model.index))}")
    error = np.sqrt(np.diag(solution.covariance))
    values, errors = {}, {}
    for i, p in enumerate(model.parameters):
        of = certified[p.name]
        values[p.name] = correct(to_display(float(solution.estimate[i]), p.unit), Decimal(of["estimate"]))
        errors[p.name] = correct(to_display(float(error[i]), p.unit), Decimal(of["standard_error"]))
    total = correct(float(np.sum(solution.residual**2)), Decimal(table["sum_of_squares"]))
    return Digits(
        values,
        errors,
        total,
        table["condition"],
        solution.iterations,
        solution.ending is FitTermination.CONVERGED,
    )


def table(names: Iterable[str] = PROBLEMS) -> str:
    """Certified digits: the fewest and the median over the parameters of every problem."""
    lines = [
        "Certified digits (log relative error, fewest and median over the parameters)",
        f"{'problem':20} {'m':>3} {'condition':>9} {'iterations':>10} {'values':>13} {'std errors':>13} {'sum sq.':>8}",
    ]
    for name in names:
        got = count(name)
        pairs = [
            f"{min(d.values()):6.1f} {float(np.median(list(d.values()))):6.1f}"
            for d in (got.values, got.errors)
        ]
        lines.append(
            f"{name:20} {len(got.values):3} {got.condition:9.3g} {got.iterations:10}"
            f" {pairs[0]} {pairs[1]} {got.sum_of_squares:8.1f}"
        )
    return "\n".join(lines)
