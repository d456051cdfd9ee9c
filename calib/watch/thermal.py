"""Thermal upkeep: a few readings between watches update how warm the arm is, and nothing else.

    r = A x + J e + T w + F f + noise,    x ~ N(0, S^2)

with x the change of the model's thermal parameters since it was written, by their usual sizes, and the rest as in a
watch (`calib.watch.seen`). First the rest is judged: with A S among what may differ with nothing changed, the questions
of a watch (T-squared, and every cause that is not thermal) ask whether anything else has changed, at the stated rate
of false alarms. Only where they do not, x is estimated, and added to the parameters.

A model that warms up follows a clock that began with a cold robot, so the readings must be on that clock (`later`).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.model.effect import Parameter
from calib.model.model import RobotModel
from calib.model.regressors import WarmUp
from calib.saved import SavedModel
from calib.units import to_internal
from calib.watch.judge import RATE, Verdict, judge
from calib.watch.seen import Seen
from calib.watch.update import Change

_SHOWN = 1e-2  # whitened length of a parameter at its usual size
_WARMTH = "arm_growth"


@dataclass(frozen=True)
class Upkept:
    """The warmth of the arm by some readings.

    rest: the verdict on what is left beside it, `unchanged` where that is chance; parameters, before (p,), change (p,)
    and covariance (p, p) of the changed ones, internal units; model: the updated one, None where the rest is no chance.
    """

    rest: Verdict
    parameters: tuple[Parameter, ...]
    before: Array
    change: Array
    covariance: Array
    model: SavedModel | None


def keep_up(saved: SavedModel, dataset: Dataset, rate: float = RATE, *, path: Path | None = None) -> Upkept:
    """Update the thermal parameters of a model by the usable readings of a data set that is no watch for another reason
    (`calib.watch.refusals`). Raises DataError for a model without a thermal effect, naming what would be needed, and
    for readings that do not show it. path: of the model, for that."""
    seen = Seen.of(saved, dataset)
    model = saved.model
    thermal = [e for e in model.effects if e.group == "thermal" and e.owner == "robot"]
    if not thermal:
        raise _without_effect(seen, rate, path)
    every = [p for e in thermal for p in e.parameters]
    sizes = {p.name: to_internal(p.size or 1.0, p.unit) for p in every}
    lengths = {p.name: np.linalg.norm(seen.of_parameters[:, model.index[p.name]]) for p in every}
    shown = tuple(p for p in every if lengths[p.name] * sizes[p.name] > _SHOWN)
    if not shown:
        raise DataError(
            f"shows nothing of {', '.join(e.label for e in thermal)}, by which the model follows its warmth.",
            do="Measure at other poses, or when the arm is as warm as in production.",
            file=dataset.path,
        )
    place = [model.index[p.name] for p in shown]
    prior = np.array([sizes[p.name] for p in shown])
    columns = seen.of_parameters[:, place]
    rest = judge(_beside(seen, columns * prior), rate=rate)
    change = Change.of(seen, columns, prior)
    values = change.estimate(seen.residual)
    kept = None
    if rest.kind == "unchanged":
        estimate = saved.estimate.copy()
        estimate[place] += values
        covariance = change.covariance_of(saved, seen, place, len(estimate))
        kept = replace(saved, estimate=estimate, covariance=covariance)
    return Upkept(rest, shown, saved.estimate[place], values, change.normal, kept)


def later(dataset: Dataset, seconds: float) -> Dataset:
    """The readings on a clock that began so many seconds before that of the data set."""
    conditions = dataset.conditions
    return replace(dataset, conditions=replace(conditions, time=conditions.time + seconds))


def warms_up(model: RobotModel) -> bool:
    """Whether a model follows the time since a cold start."""
    return any(
        isinstance(term.regressor, WarmUp) and effect.owner == "robot"
        for effect in model.effects
        for term in effect.terms
    )


def _beside(seen: Seen, columns: Array) -> Seen:
    """The readings as seen where the changes of some columns (q, p) of unit variance are no change, and warmth is no
    cause."""
    kept = [i for i, cause in enumerate(seen.causes) if cause.label != _WARMTH]
    return replace(
        seen,
        lasting=np.column_stack([seen.lasting, columns]),
        causes=tuple(seen.causes[i] for i in kept),
        columns=tuple(seen.columns[i] for i in kept),
    )


def _without_effect(seen: Seen, rate: float, path: Path | None) -> DataError:
    found = judge(seen, rate=rate)
    labels = [cause.label for cause, _ in found.causes]
    needed = ""
    if found.kind == "unchanged":
        needed = "; nor do these readings show that any would be needed"
    elif _WARMTH in labels:
        needed = "; these readings show that the arm has grown: thermal_growth (by the air) or warm_up (by the clock)"
    elif any(label.startswith("joint_step") for label in labels):
        joint = next(label for label in labels if label.startswith("joint_step")).partition(":")[2]
        needed = f"; these readings look like thermal_joint:{joint}, or like a zero that was lost"
    else:
        needed = f"; what these readings show is none: {', '.join(labels)}"
    return DataError(
        f"has no thermal effect that could be updated{needed}.",
        do="Calibrate from a cold start until the arm is warm, or over the range of the air, and diagnose.",
        file=path,
        key="effects",
    )
