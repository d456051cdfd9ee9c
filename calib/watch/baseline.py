"""Baseline of a watch: the saved model, for readings taken after its campaign.

A baseline does not explain everything: its joints scatter more than declared. The model file states this unmodelled
scatter (`calib.saved.unresolved_effects`). For a file without it, it is estimated from the held-out error:

    held-out error^2 = noise^2 + repeatability^2 + parameter uncertainty^2 + unmodelled^2

Each term is the mean square per reading: of the point if points were measured, otherwise of the distance. Most of the
unmodelled error is in angles; for a sliding joint, as many mm are assumed as deg for the others.
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
    """Prepare later readings for prediction by a saved model.

    The readings get the name of the only series of the model, regardless of their original series name. They are placed
    after every event of the calibration. If no term of the model depends on the air temperature, missing temperatures
    are replaced by the usual one of the calibration.
    """
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


_ANGLES = 2.5  # joint angles in all poses, for each parameter


def too_few_poses(saved: CalibratedModel) -> str:
    """Warn if a baseline was calibrated at too few poses to keep a stated false-alarm rate.

    With 10 poses a model of about 31 parameters absorbs most of its unmodelled errors without identifying them: of 14
    such arms 3 raised an alarm in every watch. With 17 poses none did (`tests.benchmarks.watch_baselines`).

    Returns
    -------
    str
        The warning, or an empty text.
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
    """Baseline that later readings are compared with.

    It includes the unresolved effects of the calibration. The drift of the instrument during its own campaign is
    removed.

    Attributes
    ----------
    model : ModelStructure
        Structure of the saved model, extended by the unresolved effects.
    estimate : array of shape (m + k,)
        Parameter values, internal units.
    covariance : array of shape (m + k, m + k)
        Covariance of the estimate.
    plain : array of shape (m + k,)
        Estimate with which the saved model itself predicts and corrects. Carried functions of time have the value that
        they had at the end of the campaign.
    """

    model: ModelStructure
    estimate: Array
    covariance: Array
    plain: Array

    @classmethod
    def of(cls, saved: CalibratedModel) -> Baseline:
        """Build the baseline of a saved model."""
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
        # an unresolved drift has already affected the parameters; later readings need not state the time
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
    """Freeze the carried functions of time of a baseline at their last value.

    It is not known why a term follows time, so after the campaign it may change as it did in the second half of the
    campaign. This adds one uncertainty per parameter. A step that ends in the first half adds nothing, a slow wave adds
    its whole amplitude.
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
    """Compute the RMS difference from the last value over the second half of the campaign."""
    times = np.linspace(0.5 * (function.times[0] + function.times[-1]), function.times[-1], 200)
    values = np.interp(times, function.times, function.values)
    return float(np.sqrt(np.mean((values - function.values[-1]) ** 2)))


def root_of(covariance: Array) -> Array:
    """Compute R, shape (m, m), with R R' = covariance.

    The covariance may be singular, and may contain mm^2 together with (rad/(N.mm))^2.
    """
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))


def unmodelled_scatter(saved: CalibratedModel, dataset: Dataset) -> Array:
    """Return the joint scatter beyond the declared repeatability.

    The model file states it. For a file without it, one angle for all joints is estimated from the held-out error, or
    from the errors of the fit if no readings were held out. It is zero if these errors are as declared.

    Returns
    -------
    array of shape (N,)
        Standard deviation of each joint, rad; a sliding joint scatters by as many mm as deg.
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
