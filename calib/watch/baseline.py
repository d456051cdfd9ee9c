"""The baseline of a watch: the saved model, for readings that were taken after its campaign.

The lack of a baseline: additional scatter of the joints, as its file says (`calib.saved.unresolved_effects`);
of a file that does not, by the errors that it left on readings it had not seen:

    held-out error^2 = noise + repeatability + what its parameters are uncertain by + lack

each as the mean square of a reading, of its point where points were measured, else of its distance. What a model lacks
is mostly angles; a slide is taken to lack as many mm as others deg.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.fit.least_squares import jacobian
from calib.fit.readings import readings_of
from calib.model.carried_regressors import OfTime
from calib.model.effect import EffectTerm
from calib.model.model import AFTER_EVERYTHING, BoundModel, ModelStructure
from calib.model.regressors import Constant, Temperature, Time, WarmUpRegressor
from calib.saved import CalibratedModel


def in_series(saved: CalibratedModel, dataset: Dataset) -> Dataset:
    """The readings in the one series of a model, whatever both call it, after all that the model says happened during
    the calibration, and where no law of the model needs the air, in that of the calibration unless they say theirs."""
    model, conditions = saved.model, saved.loaded(dataset).conditions
    air = conditions.temperature
    if not any(isinstance(term.regressor, Temperature) for effect in model.effects for term in effect.terms):
        air = np.where(np.isfinite(air), air, saved.usual.temperature_c)
    conditions = replace(
        conditions,
        series_names=(next(iter(model.targets)),),
        order=np.full(len(conditions), AFTER_EVERYTHING),
        temperature=air,
    )
    return replace(dataset, conditions=conditions)


_ANGLES = 2.5  # of joints in all poses, for each parameter


def too_few_poses(saved: CalibratedModel) -> str:
    """A sentence where a baseline was calibrated at too few poses to hold a stated rate of false alarms, else empty.

    With 10 poses a model of some 31 parameters absorbs most of what it lacks without naming it: of 14 such arms 3
    alarmed in every watch. With 17 poses none did (`tests.benchmarks.watch_baselines`).
    """
    poses = None if saved.left_open is None else saved.left_open.poses
    free = np.count_nonzero(np.diag(saved.covariance))
    need = int(np.ceil(_ANGLES * free / saved.model.robot.joints))
    if poses is None or poses >= need:
        return ""
    return (
        f"The baseline was calibrated at {poses:g} poses, too few to hold a rate of false alarms: what happened "
        f"unnamed in it is taken for a change since. Calibrate at {need} poses or more."
    )


@dataclass(frozen=True)
class Baseline:
    """The baseline that later readings are compared with: model, estimate (m + k,) and covariance (m + k, m + k), with
    what the calibration left open and without what the instrument did with time in its own campaign.

    plain (m + k,): the estimate by which the saved model itself predicts, and corrects. Carried functions of time have
    the value that they had at the end of the campaign.
    """

    model: ModelStructure
    estimate: Array
    covariance: Array
    plain: Array

    @classmethod
    def of(cls, saved: CalibratedModel) -> Baseline:
        """The baseline that a saved model is."""
        model, estimate, covariance = saved.model, saved.estimate, saved.covariance
        if saved.left_open is not None:
            model, estimate, covariance = saved.left_open.beside(model, estimate, covariance)
        gone = {
            term.parameter
            for effect in model.effects
            if effect.owner == "instrument"
            for term in effect.terms
            if isinstance(term.regressor, Time | WarmUpRegressor | OfTime)
        }
        # a drift that was left open has done what it did to the parameters; later readings need not carry the time
        own = len(saved.model.effects)
        effects = tuple(
            e for k, e in enumerate(model.effects) if k < own or not {p.name for p in e.parameters} <= gone
        )
        held = [model.index[p.name] for e in effects for p in e.parameters]
        model, estimate = replace(model, effects=effects), estimate[held]
        kept = np.array([p.name not in gone for p in model.parameters], dtype=float)
        plain = np.concatenate([saved.estimate, np.zeros(len(estimate) - len(saved.estimate))])
        covariance = covariance[np.ix_(held, held)] * np.outer(kept, kept)
        return cls(*_after_campaign(model, estimate * kept, covariance, plain * kept))


def _after_campaign(
    model: ModelStructure, estimate: Array, covariance: Array, plain: Array
) -> tuple[ModelStructure, Array, Array, Array]:
    """A baseline whose carried functions of time keep their last value, whenever a watch is.

    Why a term follows time is not known, so it may do after the campaign what it did in its second half. That is one
    more uncertainty per parameter; a step that is over in the first half adds nothing, a slow wave its whole size.
    """
    effects, again, spread = [], [], []
    for effect in model.effects:
        if not any(isinstance(term.regressor, OfTime) for term in effect.terms):
            effects.append(effect)
            continue
        effects.append(replace(effect, terms=tuple(_weighed(t, _last) for t in effect.terms)))
        later = replace(effect, label=f"{_LATER}:{effect.label}").apart(_LATER)
        of_time = tuple(_weighed(t, _moved_late) for t in later.terms if isinstance(t.regressor, OfTime))
        again.append(replace(later, terms=of_time))
        spread.extend(float(estimate[model.index[p.name]]) ** 2 for p in effect.parameters)
    more = np.zeros(len(spread))
    whole = np.zeros(2 * (len(estimate) + len(spread),))
    whole[: len(estimate), : len(estimate)] = covariance
    whole[len(estimate) :, len(estimate) :] = np.diag(spread)
    model = replace(model, effects=(*effects, *again))
    return model, np.concatenate([estimate, more]), whole, np.concatenate([plain, more])


_LATER = "later"


def _weighed(term: EffectTerm, value: Callable[[OfTime], float]) -> EffectTerm:
    if not isinstance(term.regressor, OfTime):
        return term
    return replace(term, weight=term.weight * value(term.regressor), regressor=Constant())


def _last(function: OfTime) -> float:
    return function.values[-1]


def _moved_late(function: OfTime) -> float:
    """Root mean square of the difference from the last value, over the second half of the campaign."""
    times = np.linspace(0.5 * (function.times[0] + function.times[-1]), function.times[-1], 200)
    values = np.interp(times, function.times, function.values)
    return float(np.sqrt(np.mean((values - function.values[-1]) ** 2)))


def root_of(covariance: Array) -> Array:
    """(m, m) R with R R' = covariance, which may be singular, and has squares of mm beside such of rad/(N.mm)."""
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def unmodelled_scatter(saved: CalibratedModel, dataset: Dataset) -> Array:
    """(N,) the angles, rad, by which the joints scatter more than declared, as the file of the model says.

    Of a file that does not say it, the one angle by which all would have to for the errors that the calibration found
    on readings it had not seen; without such readings, for those of its fit. Nothing where these are as declared.
    """
    if saved.left_open is not None and saved.left_open.scatter is not None:
        return saved.left_open.scatter
    dataset = in_series(saved, dataset)
    baseline = Baseline.of(replace(saved, left_open=None))
    model, estimate, covariance = baseline.model, baseline.estimate, baseline.covariance
    of_points = bool((dataset.fit_rows & dataset.pointed).any())
    rows = dataset.fit_rows & (dataset.pointed if of_points else dataset.spanned)
    if not rows.any():
        return np.zeros(saved.model.robot.joints)
    readings = readings_of(dataset, rows, model, estimate)
    joints, noise = model.robot.joint_slots, dataset.header.noise
    design = BoundModel(model, readings.conditions)
    frames = design.frames(estimate, {*design.slots, *joints})
    size = readings.observed.whiten.shape[0]
    n = len(readings.conditions)
    plain = replace(readings.observed, whiten=np.eye(size)[:, :, None] * np.ones(n), shared=None)
    judged = slice(0, 3) if of_points else slice(size - 1, None)
    by_joint = np.mean(np.sum(plain.columns(frames, joints)[:, judged] ** 2, axis=1), axis=1)
    columns = jacobian(design, plain, frames).reshape(size, n, -1)[judged]
    uncertain = float(np.einsum("knm,knm->", columns @ covariance, columns)) / n
    if of_points:
        covariances = noise.of_points(dataset.points[rows], dataset.u_point[rows])
        instrument = float(np.mean(np.trace(covariances, axis1=1, axis2=2)))
    else:
        given = dataset.u_length[rows]
        instrument = float(np.mean(np.where(np.isfinite(given), given, noise.length_mm) ** 2))
    known = instrument + float(noise.of_each_joint(model.robot.kinds) ** 2 @ by_joint)
    held_out = saved.held_out_rms_mm
    beyond = (saved.noise_scale**2 - 1.0) * known if held_out is None else held_out**2 - known - uncertain
    steps = model.robot.steps
    return np.full(len(steps), np.sqrt(max(beyond, 0.0) / float(steps**2 @ by_joint)))
