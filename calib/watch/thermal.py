"""Thermal update: a few readings between watches correct only the warmth of the arm.

    r = A x + J e + T w + F f + noise,    x ~ N(0, S^2)

with x the change of the model's thermal parameters since it was written, S their usual sizes, and the other terms as in
a watch (`calib.watch.whitened_readings`). First the other terms are judged: A S is added to what may differ in an
unchanged robot. The tests of a watch (T-squared, and every cause that is not thermal) then show whether there is
another change, at the stated false-alarm rate. Only without another change, x is estimated and added to the parameters.

A model that warms up uses a clock that started with a cold robot, so the readings must use that clock (`later`).

The same equations update a baseline after a change: the parameters of one cause change, all others stay.

With e ~ P the error of the baseline and r = A x + J e + ... (`calib.watch.whitened_readings`), the estimate of x
is that of a least squares in which e is noise. Therefore

    cov(x) = N = (A' C^-1 A + S^-2)^-1,      cov(e, x) = -P J' C^-1 A N,

and predictions at the poses of the watch are as certain as its readings, for any error of the baseline there.
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
    """Change of the thermal parameters according to some readings.

    Attributes
    ----------
    rest : WatchVerdict
        Verdict on the remaining residual: `unchanged` if it is explained by chance.
    parameters : tuple of Parameter
        Changed parameters.
    before, change : array of shape (p,)
        Their values before the update and the changes, internal units.
    covariance : array of shape (p, p)
        Covariance of the changes, internal units.
    model : CalibratedModel or None
        Updated model. None if the remaining residual is not explained by chance.
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
    """Update the thermal parameters of a model from the usable readings of a data set.

    Check with `calib.watch.refusals` first that the data set can be compared with the model in all other respects.

    Parameters
    ----------
    rate : float, optional
        False-alarm rate of the test for other changes.
    path : Path, optional
        File of the model, for messages.

    Raises
    ------
    DataError
        The model has no thermal effect (the message names the effect that would be needed), or the readings do not show
        it.
    """
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
            f"shows nothing of {', '.join(e.label for e in thermal)}, with which the model follows its temperature.",
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
    """Shift the readings to a clock that started `seconds` before that of the data set."""
    conditions = dataset.conditions
    return replace(dataset, conditions=replace(conditions, time=conditions.time + seconds))


def warms_up(model: ModelStructure) -> bool:
    """Check if a model depends on the time since a cold start."""
    return any(
        isinstance(term.regressor, WarmUpRegressor) and effect.owner == "robot"
        for effect in model.effects
        for term in effect.terms
    )


def _beside(seen: WhitenedReadings, columns: Array) -> WhitenedReadings:
    """Treat changes along some columns (q, p) of unit variance as no change.

    Warmth is then no longer a possible cause.
    """
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
        needed = f"; these readings look like thermal_joint:{joint}, or like a lost zero of that joint"
    else:
        needed = f"; the effects in these readings are not thermal: {', '.join(labels)}"
    return DataError(
        f"has no thermal effect that could be updated{needed}.",
        do="Measure a calibration from a cold start until the arm is warm, or over the range "
        "of air temperatures. Use its model from 'truepose diagnose DATA.csv --model'.",
        file=path,
        key="effects",
    )


def updated(
    saved: CalibratedModel, seen: WhitenedReadings, cause: Cause
) -> tuple[ModelStructure, Array, Array]:
    """Apply a change to a model.

    If the model has an effect with the label of the cause, its parameters are changed. Otherwise the effect is
    appended.

    Returns
    -------
    model : ModelStructure
    estimate : array of shape (m,)
    covariance : array of shape (m, m)
        In internal units.
    """
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
    """Change x of some parameters according to the readings.

    Attributes
    ----------
    weighed : array of shape (q, p)
        C^-1 A, internal units.
    normal : array of shape (p, p)
        Covariance N of the change, internal units.
    """

    weighed: Array
    normal: Array

    @classmethod
    def of(cls, seen: WhitenedReadings, columns: Array, prior: Array) -> ParameterChange:
        """Build the change along columns (q, p), whitened by noise.

        The argument `prior` (p,) contains the usual sizes of the parameters.
        """
        weighed: Array = np.asarray(np.linalg.solve(seen.spread(), columns), dtype=np.float64)
        information = columns.T @ weighed + np.diag(prior**-2.0)
        return cls(weighed, np.asarray(np.linalg.inv(information), dtype=np.float64))

    def estimate(self, residual: Array) -> Array:
        """Estimate the change (p,) from a whitened residual (q,), internal units."""
        return self.normal @ (self.weighed.T @ residual)

    def covariance_of(
        self, saved: CalibratedModel, seen: WhitenedReadings, place: Sequence[int], size: int
    ) -> Array:
        """Compute the covariance (size, size) of the estimate after the change is added at `place`."""
        old = len(saved.estimate)
        # excludes the drift of the instrument during its own campaign
        acts = np.flatnonzero(np.diag(seen.covariance)[:old] > 0.0)
        shared = -saved.covariance[:, acts] @ seen.of_parameters[:, acts].T @ self.weighed @ self.normal
        into = np.zeros((size, old + len(place)))
        into[:old, :old] = np.eye(old)
        into[place, old + np.arange(len(place))] += 1.0
        joint = np.block([[saved.covariance, shared], [shared.T, self.normal]])
        return into @ joint @ into.T


def cause_to_update(verdict: WatchVerdict) -> Cause:
    """Return the cause by which a model may be updated.

    It is the identified cause, or the likeliest of several that no poses distinguish, because they move the robot
    alike.

    Raises
    ------
    DataError
        Nothing has changed, the change is not explained, it passes by itself, or other poses could distinguish its
        causes.
    """
    if verdict.kind == "unchanged":
        raise DataError(
            "nothing has changed: there is nothing to update.", do="Keep using the model.", file="--update"
        )
    if verdict.kind == "unexplained":
        raise DataError(
            "the cause of the change is not known: no parameter can be updated.",
            do="Recalibrate.",
            file="--update",
        )
    if (likeliest := verdict.causes[0][0]).label.partition(":")[0] in _PASSING:
        raise DataError(
            f"the cause is {likeliest.label}, which is temporary and not a property of the robot.",
            do=likeliest.remedy,
            file="--update",
        )
    if verdict.apart:
        names = ", ".join(cause.label for cause, _ in verdict.causes)
        raise DataError(
            f"the cause is one of {names}, which predict different errors at other poses.",
            do="Measure again with more poses, or recalibrate.",
            file="--update",
        )
    return verdict.causes[0][0]
