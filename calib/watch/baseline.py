"""The baseline of a watch: the saved model, for readings that were taken after its campaign."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.arm.kinematics import statics
from calib.arm.robot import Load
from calib.array import Array
from calib.data.dataset import Dataset
from calib.data.header import Header
from calib.model.model import RobotModel
from calib.model.regressors import Temperature, Time, WarmUp
from calib.model.stated import AFTER_EVERYTHING
from calib.saved import SavedModel


def in_series(saved: SavedModel, dataset: Dataset) -> Dataset:
    """The readings in the one series of a model, whatever both call it, after all that the model says happened during
    the calibration, and where no law of the model needs the air, in that of the calibration unless they say theirs."""
    model, conditions = saved.model, dataset.conditions
    air = conditions.temperature
    if not any(isinstance(term.regressor, Temperature) for effect in model.effects for term in effect.terms):
        air = np.where(np.isfinite(air), air, saved.usual.temperature_c)
    if (loads := loads_as_in(saved, dataset.header)) != dataset.header.loads:
        there = statics(model.robot, conditions.joints, loads, dataset.header.gravity)
        conditions = replace(
            conditions, torque=there.torque, moment=there.moment, overturning=there.overturning
        )
    conditions = replace(
        conditions,
        series_names=(next(iter(model.targets)),),
        order=np.full(len(conditions), AFTER_EVERYTHING),
        temperature=air,
    )
    return replace(dataset, conditions=conditions)


def loads_as_in(saved: SavedModel, header: Header) -> tuple[Load, ...]:
    """The loads of a header, without the estimates of the robot file if the baseline is from before these."""
    estimates = header.robot.loads if header.robot.loads_estimated else ()
    return header.loads if any(load in estimates for load in saved.loads) else header.declared_loads


_ANGLES = 2.5  # of joints in all poses, for each parameter


def too_few_poses(saved: SavedModel) -> str:
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

    plain (m + k,): the estimate by which the saved model itself predicts, and corrects.
    """

    model: RobotModel
    estimate: Array
    covariance: Array
    plain: Array

    @classmethod
    def of(cls, saved: SavedModel) -> Baseline:
        """The baseline that a saved model is."""
        model, estimate, covariance = saved.model, saved.estimate, saved.covariance
        if saved.left_open is not None:
            model, estimate, covariance = saved.left_open.beside(model, estimate, covariance)
        gone = {
            term.parameter
            for effect in model.effects
            if effect.owner == "instrument"
            for term in effect.terms
            if isinstance(term.regressor, Time | WarmUp)
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
        return cls(
            model, estimate * kept, covariance[np.ix_(held, held)] * np.outer(kept, kept), plain * kept
        )


def root_of(covariance: Array) -> Array:
    """(m, m) R with R R' = covariance, which may be singular, and has squares of mm beside such of rad/(N.mm)."""
    size = np.sqrt(np.diag(covariance))
    scale = np.where(size > 0.0, size, 1.0)
    values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
    return size[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
