"""Thermal upkeep: a few readings between watches update how warm the arm is, and nothing else.

    r = A x + J e + T w + F f + noise,    x ~ N(0, S^2)

with x the change of the model's thermal parameters since it was written, by their usual sizes, and the rest as in a
watch (`calib.watch.whitened_readings`). First the rest is judged: with A S among what may differ with nothing changed,
the questions of a watch (T-squared, and every cause that is not thermal) ask whether anything else has changed,
at the stated rate of false alarms. Only where they do not, x is estimated, and added to the parameters.

A model that warms up follows a clock that began with a cold robot, so the readings must be on that clock (`later`).

The update of a baseline: the parameters of one cause change, everything else stays.

With e ~ P the error of the baseline and r = A x + J e + ... (`calib.watch.whitened_readings`), the estimate of x
is that of a least squares in which e is noise; so

    cov(x) = N = (A' C^-1 A + S^-2)^-1,      cov(e, x) = -P J' C^-1 A N,

and predictions at the poses of the watch are as sure as its readings, whatever the baseline did not know there.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.errors import DataError
from calib.model.effect import Parameter
from calib.model.model import ModelStructure
from calib.model.regressors import WarmUpRegressor
from calib.saved import CalibratedModel
from calib.units import to_internal
from calib.watch.cause import Cause
from calib.watch.judge import RATE, WatchVerdict, judge
from calib.watch.whitened_readings import WhitenedReadings

_SHOWN = 1e-2  # whitened length of a parameter at its usual size
_WARMTH = "arm_growth"
_PASSING = ("arm_growth", "drift_translation", "drift_rotation")
"""Causes that are gone when the robot is as warm as it was, or the instrument is."""


@dataclass(frozen=True)
class ThermalUpdate:
    """The warmth of the arm by some readings.

    rest: the verdict on what is left beside it, `unchanged` where that is chance; parameters, before (p,), change (p,)
    and covariance (p, p) of the changed ones, internal units; model: the updated one, None where the rest is no chance.
    """

    rest: WatchVerdict
    parameters: tuple[Parameter, ...]
    before: Array
    change: Array
    covariance: Array
    model: CalibratedModel | None


def keep_up(
    saved: CalibratedModel, dataset: Dataset, rate: float = RATE, *, path: Path | None = None
) -> ThermalUpdate:
    """Update the thermal parameters of a model by the usable readings of a data set that is no watch for another reason
    (`calib.watch.refusals`). Raises DataError for a model without a thermal effect, naming what would be needed, and
    for readings that do not show it. path: of the model, for that."""
    seen = WhitenedReadings.of(saved, dataset)
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
    change = ParameterChange.of(seen, columns, prior)
    values = change.estimate(seen.residual)
    kept = None
    if rest.kind == "unchanged":
        estimate = saved.estimate.copy()
        estimate[place] += values
        covariance = change.covariance_of(saved, seen, place, len(estimate))
        kept = replace(saved, estimate=estimate, covariance=covariance)
    return ThermalUpdate(rest, shown, saved.estimate[place], values, change.normal, kept)


def later(dataset: Dataset, seconds: float) -> Dataset:
    """The readings on a clock that began so many seconds before that of the data set."""
    conditions = dataset.conditions
    return replace(dataset, conditions=replace(conditions, time=conditions.time + seconds))


def warms_up(model: ModelStructure) -> bool:
    """Whether a model follows the time since a cold start."""
    return any(
        isinstance(term.regressor, WarmUpRegressor) and effect.owner == "robot"
        for effect in model.effects
        for term in effect.terms
    )


def _beside(seen: WhitenedReadings, columns: Array) -> WhitenedReadings:
    """The readings as seen where the changes of some columns (q, p) of unit variance are no change, and warmth is no
    cause."""
    kept = [i for i, cause in enumerate(seen.causes) if cause.label != _WARMTH]
    return replace(
        seen,
        lasting=np.column_stack([seen.lasting, columns]),
        causes=tuple(seen.causes[i] for i in kept),
        columns=tuple(seen.columns[i] for i in kept),
    )


def _without_effect(seen: WhitenedReadings, rate: float, path: Path | None) -> DataError:
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


def updated(
    saved: CalibratedModel, seen: WhitenedReadings, cause: Cause
) -> tuple[ModelStructure, Array, Array]:
    """Model, estimate (m,) and covariance (m, m) with a change, internal units. What the model has already under the
    label of the cause is changed, else the effect is appended."""
    effect = next(e for e in seen.causes if e.label == cause.label)
    model, old = saved.model, len(saved.estimate)
    if any(p.name in model.index for p in effect.parameters):
        goal, place = model, [model.index[p.name] for p in effect.parameters]
    else:
        goal, place = model.append(effect), list(range(old, old + len(effect.parameters)))
    estimate = np.concatenate([saved.estimate, np.zeros(len(goal.parameters) - old)])
    estimate[place] += cause.values
    columns = seen.columns[seen.causes.index(effect)]
    by_reading = np.linalg.solve(seen.spread(), columns)
    change = ParameterChange(np.asarray(by_reading, dtype=np.float64), cause.covariance)
    return goal, estimate, change.covariance_of(saved, seen, place, len(estimate))


@dataclass(frozen=True)
class ParameterChange:
    """A change x of some parameters as readings see it: C^-1 A (q, p), and its covariance N (p, p), internal units."""

    weighed: Array
    normal: Array

    @classmethod
    def of(cls, seen: WhitenedReadings, columns: Array, prior: Array) -> ParameterChange:
        """The change along columns (q, p), whitened by noise; prior (p,): usual sizes of the parameters."""
        weighed: Array = np.asarray(np.linalg.solve(seen.spread(), columns), dtype=np.float64)
        information = columns.T @ weighed + np.diag(prior**-2.0)
        return cls(weighed, np.asarray(np.linalg.inv(information), dtype=np.float64))

    def estimate(self, residual: Array) -> Array:
        """The change (p,) that a whitened residual (q,) shows, internal units."""
        return self.normal @ (self.weighed.T @ residual)

    def covariance_of(
        self, saved: CalibratedModel, seen: WhitenedReadings, place: Sequence[int], size: int
    ) -> Array:
        """(size, size) covariance of the estimate once the change is added at some places of it."""
        old = len(saved.estimate)
        # not what the instrument did with time in its own campaign
        acts = np.flatnonzero(np.diag(seen.covariance)[:old] > 0.0)
        shared = -saved.covariance[:, acts] @ seen.of_parameters[:, acts].T @ self.weighed @ self.normal
        into = np.zeros((size, old + len(place)))
        into[:old, :old] = np.eye(old)
        into[place, old + np.arange(len(place))] += 1.0
        joint = np.block([[saved.covariance, shared], [shared.T, self.normal]])
        return into @ joint @ into.T


def cause_to_update(verdict: WatchVerdict) -> Cause:
    """The cause by which a model may be updated: one that is named alone, or the likeliest of those that no poses tell
    apart, since they move the robot alike. Raises DataError for another verdict."""
    if verdict.kind == "unchanged":
        raise DataError(
            "nothing has changed: there is nothing to update.", do="Go on with the model.", file="--update"
        )
    if verdict.kind == "unexplained":
        raise DataError(
            "what has changed is not known: no parameter can be updated.", do="Recalibrate.", file="--update"
        )
    if (likeliest := verdict.causes[0][0]).label.partition(":")[0] in _PASSING:
        raise DataError(
            f"the cause is {likeliest.label}, which passes: it is no property of the robot.",
            do=likeliest.remedy,
            file="--update",
        )
    if verdict.apart:
        names = ", ".join(cause.label for cause, _ in verdict.causes)
        raise DataError(
            f"the cause is one of {names}, which move the robot differently elsewhere.",
            do="Measure again with more poses, or recalibrate.",
            file="--update",
        )
    return verdict.causes[0][0]
