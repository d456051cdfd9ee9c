"""Comparison of regression and identification on the same readings, in one table.

Errors are given in sample and by waypoint. By waypoint, whole waypoints are left out in five parts. Everything is
done again with the rest: the fit of the physical model, the diagnosis, and the choice of gamma and lambda. Errors
are measured minus predicted, along the axes of the world.

Samples between which the robot hardly moved share a waypoint.

A data set is prepared for each level of calibration. The level states which parameters are freed. Parameters that
no reading determines are held.

Each regression is also tested a few degrees away from its samples, at the same postures with one wrist joint
turned. There are no measurements there, so the fitted model takes the place of the arm. A model of geometry carries
over to such postures. A regression on absolute positions has never seen its columns move, and a regression on
residuals can only add a little.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from calib.arm.kinematics import statics
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.data.header import LEVELS, Header
from calib.diagnose.diagnosis import diagnose
from calib.errors import DataError
from calib.fit.identification import IdentificationFit
from calib.fit.identify import Progress, identify, last_joint_unseen, silent
from calib.fit.placing import base_model_of, place_nominal
from calib.fit.readings import readings_of
from calib.model import base_model
from calib.model.model import BoundModel, ModelStructure
from calib.regression.mls_svr import folds_of
from calib.regression.regression import Regression, RegressionRequest, train
from calib.units import DEG
from calib.validation.holdout import without

TURN = 5.0 * DEG
_WRIST = 3  # joints


@dataclass(frozen=True)
class TurnedPostureTest:
    """Difference between a predictor and the fitted model with the worst wrist joint turned.

    Attributes
    ----------
    mean, largest : float
        Mean and largest difference, mm.
    inside : float
        Share of the turned postures within the region of the regression, in which it would be used.
    """

    name: str
    joint: int
    mean: float
    largest: float
    inside: float


def away(comparison: RegressionComparison) -> tuple[TurnedPostureTest, ...]:
    """Test each trained regression with the wrist turned away.

    A regression on positions is compared with the model of the requested level.
    """
    predictors = {s.predictor.name: s.predictor for s in comparison.scored}
    conditions = comparison.dataset.conditions.take(comparison.rows)
    out = []
    for predictor in predictors.values():
        if predictor.regression is None:
            continue
        beside = predictors.get(f"level {comparison.plan.level}")
        model = (
            replace(predictor, regression=None) if predictor.regression.wanted.on == "residuals" else beside
        )
        if model is not None:
            out.append(_worst(predictor, model, conditions, comparison.dataset.header))
    return tuple(out)


def _worst(
    predictor: Predictor, model: Predictor, conditions: Conditions, header: Header
) -> TurnedPostureTest:
    assert predictor.regression is not None
    count = conditions.joints.shape[1]
    found = []
    for joint in range(max(0, count - _WRIST), count):
        turned = _turned(conditions, header, conditions.joints + TURN * np.eye(count)[joint])
        apart = np.linalg.norm(predictor.predict(turned) - model.predict(turned), axis=1)
        inside = float(predictor.regression.region.holds(turned.joints).mean())
        found.append(
            TurnedPostureTest(predictor.name, joint + 1, float(apart.mean()), float(apart.max()), inside)
        )
    return max(found, key=lambda each: each.mean)


def _turned(conditions: Conditions, header: Header, joints: Array) -> Conditions:
    """Replace the joints (n, N), rad, of conditions, and the loads accordingly."""
    load = statics(header.robot, joints, header.loads, header.gravity)
    return replace(
        conditions,
        joints=joints,
        previous=conditions.previous + joints - conditions.joints,
        torque=load.torque,
        moment=load.moment,
        overturning=load.overturning,
        unit_load=load.unit_load,
    )


PLACE = ("base",)
"""What is freed of the nominal robot in its place."""

_BESIDE = ("tool", "length_zero")  # not a matter of levels: the header frees them or not


def freeing(dataset: Dataset, groups: Sequence[str]) -> Dataset:
    """Replace the parameter groups in the header of a data set.

    An unknown tool or zero of lengths stays free. Parameters of other groups that the header holds or weights are
    left out. If all targets lie on the axis of the last joint, its zero is held. A reflector straight below the
    flange is a usual set-up, and the last joint does not move it.
    """
    header = dataset.header
    groups = (*groups, *(g for g in _BESIDE if g in header.groups))
    header = replace(header, groups=groups, hold=(), priors={})
    model = base_model_of(replace(dataset, header=header))
    last = f"theta{header.robot.joints}"
    unseen = "tool" not in groups and last_joint_unseen(dataset)
    hold = (*dataset.header.hold, last) if unseen else dataset.header.hold
    kinds = base_model.kinds_of(model.effects)
    priors = {name: size for name, size in dataset.header.priors.items() if name in kinds | set(model.index)}
    held = tuple(dict.fromkeys(name for name in hold if name in model.index))
    return replace(dataset, header=replace(header, hold=held, priors=priors))


SAME = 0.2 * DEG
"""Samples whose joints all lie within this of each other, or of a sample between them, are of one waypoint."""


def waypoints_of(dataset: Dataset) -> NDArray[np.int64]:
    """Number the waypoints of the readings, shape (n,).

    If the campaign stops at its poses, each pose is a waypoint.
    """
    joints = dataset.conditions.joints
    pairs = KDTree(joints).query_pairs(SAME, p=np.inf, output_type="ndarray")
    linked = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(len(joints),) * 2)
    return connected_components(linked, directed=False)[1].astype(np.int64)


NOMINAL = "nominal robot, placed"
DIAGNOSIS = "diagnosis"
_FEWEST = 3  # waypoints: one left out of the comparison, two to choose by


@dataclass(frozen=True)
class ComparisonRequest:
    """The options of a comparison.

    Attributes
    ----------
    wanted : RegressionRequest
        The requested regression.
    level : int
        Level of the model that it is based on, 2 or 3.
    compare : bool
        Whether to include the other level and the other kind of regression.
    diagnosed : bool
        Whether to include the diagnosis, and a regression on its residuals.
    """

    wanted: RegressionRequest
    level: int = 3
    compare: bool = False
    diagnosed: bool = False


@dataclass(frozen=True)
class Predictor:
    """A predictor: a model, with a regression added to it if there is one.

    `found` is the fit behind the model, None for the nominal robot. `asked` states whether a regression was
    requested.
    """

    name: str
    model: ModelStructure
    estimate: Array
    found: IdentificationFit | None = None
    regression: Regression | None = None
    asked: bool = False

    def predict(self, conditions: Conditions) -> Array:
        """Predict points in the world, mm, shape (n, 3)."""
        if self.regression is None:
            return BoundModel(self.model, conditions).predict(self.estimate)
        return self.regression.predict(self.model, self.estimate, conditions)


@dataclass(frozen=True)
class Scored:
    """A predictor, and its errors (n, 3), mm, in sample and on waypoints left out."""

    predictor: Predictor
    in_sample: Array
    by_waypoint: Array


@dataclass(frozen=True)
class RegressionComparison:
    """Errors of all predictors on the same readings.

    Attributes
    ----------
    rows : array of int, shape (n,)
        Rows of the readings in the data set.
    waypoint : array of int, shape (n,)
        Waypoint of each reading.
    """

    dataset: Dataset
    plan: ComparisonRequest
    rows: NDArray[np.int64]
    waypoint: NDArray[np.int64]
    scored: tuple[Scored, ...]

    @property
    def asked(self) -> Scored:
        """The requested regression."""
        name = name_of(self.plan.wanted.on, f"level {self.plan.level}")
        return next(s for s in self.scored if s.predictor.name == name)


def name_of(on: str, base: str) -> str:
    """Name a regression on positions, or on the residuals of a model."""
    return "MLS-SVR on positions" if on == "positions" else f"MLS-SVR on residuals of {base}"


def compare(
    dataset: Dataset, plan: ComparisonRequest, *, progress: Progress = silent
) -> RegressionComparison:
    """Compare the predictors of a plan on the readings of points that may enter a fit.

    Raises
    ------
    DataError
        There are no points or too few waypoints, or the readings left in a part cannot determine the model.
    """
    rows = dataset.fit_rows & dataset.pointed
    waypoint = waypoints_of(dataset)
    if not rows.any():
        raise DataError(
            "holds no calibration rows with points, and the regression is one on positions.",
            do="Measure x_mm, y_mm, z_mm with set = calibration.",
            file=dataset.path,
            key="x_mm",
        )
    count = len(np.unique(waypoint[rows]))
    if count < _FEWEST:
        raise DataError(
            f"holds {'one waypoint' if count == 1 else f'{count} waypoints'}: nothing can be left out to judge and to "
            "choose by.",
            do="Measure at more waypoints, some 30 or more.",
            file=dataset.path,
            key="j1_deg",
        )
    try:
        return _compared(dataset, plan, rows, waypoint, progress)
    except DataError as error:
        if error.file is not None:
            raise
        raise DataError(error.what, do=error.do, file=dataset.path, key=error.key) from error


def _compared(
    dataset: Dataset,
    plan: ComparisonRequest,
    rows: NDArray[np.bool_],
    waypoint: NDArray[np.int64],
    progress: Progress,
) -> RegressionComparison:
    progress("fitting all readings")
    predictors = _predictors(dataset, plan, waypoint)
    everything = dataset.conditions.take(rows)
    measured, index = dataset.points[rows], np.flatnonzero(rows)
    in_sample = {name: measured - predictor.predict(everything) for name, predictor in predictors.items()}
    left_out = {name: np.full_like(measured, np.nan) for name in predictors}
    folds = folds_of(waypoint[rows])
    for k, held in enumerate(folds, start=1):
        progress(f"leaving waypoints out, part {k} of {len(folds)}")
        away = np.zeros(len(dataset), dtype=bool)
        away[index[held]] = True
        for name, predictor in _predictors(without(dataset, away), plan, waypoint).items():
            left_out[name][held] = measured[held] - predictor.predict(dataset.conditions.take(away))
    scored = tuple(
        Scored(predictor, in_sample[name], left_out[name]) for name, predictor in predictors.items()
    )
    return RegressionComparison(dataset, plan, index, waypoint[rows], scored)


def _predictors(
    dataset: Dataset, plan: ComparisonRequest, waypoint: NDArray[np.int64]
) -> Mapping[str, Predictor]:
    """Fit all predictors of the plan to the rows of a data set that may enter a fit."""
    placed = freeing(dataset, PLACE)
    out = {NOMINAL: Predictor(NOMINAL, *place_nominal(placed, base_model_of(placed)))}
    if plan.compare or plan.wanted.on == "positions":
        out |= _on_positions(placed, plan, waypoint)
    for level in (2, 3) if plan.compare or plan.diagnosed else (plan.level,):
        freed = freeing(dataset, LEVELS[level])
        out |= _with_residuals(f"level {level}", identify(freed), dataset, plan, waypoint)
    if plan.diagnosed:
        final = diagnose(freeing(dataset, LEVELS[plan.level])).final
        out |= _with_residuals(DIAGNOSIS, final, dataset, plan, waypoint)
    return out


def _on_positions(
    dataset: Dataset, plan: ComparisonRequest, waypoint: NDArray[np.int64]
) -> dict[str, Predictor]:
    found = identify(dataset)
    wanted = RegressionRequest("positions", plan.wanted.features, plan.wanted.kernel)
    # Every reading takes part: a nominal robot cannot say which of them do not belong.
    rows = dataset.fit_rows & dataset.pointed
    readings = readings_of(dataset, rows, found.model, found.estimate)
    trained = train(wanted, found.model, found.estimate, readings, waypoint[rows])
    name = name_of("positions", "")
    return {name: Predictor(name, found.model, found.estimate, found, trained, asked=True)}


def _with_residuals(
    base: str,
    found: IdentificationFit,
    dataset: Dataset,
    plan: ComparisonRequest,
    waypoint: NDArray[np.int64],
) -> dict[str, Predictor]:
    out = {base: Predictor(base, found.model, found.estimate, found)}
    if plan.compare or plan.diagnosed or plan.wanted.on == "residuals":
        wanted = RegressionRequest("residuals", plan.wanted.features, plan.wanted.kernel)
        readings = found.readings.take(dataset.pointed[found.readings.rows])
        trained = train(wanted, found.model, found.estimate, readings, waypoint[readings.rows])
        name = name_of("residuals", base)
        out[name] = Predictor(name, found.model, found.estimate, found, trained, asked=True)
    return out


def mae(errors: Array) -> Array:
    """Compute the mean absolute value of errors (n, 3) along x, y and z, and its mean, (4,)."""
    each = np.abs(errors).mean(axis=0)
    return np.append(each, each.mean())


def rmse(errors: Array) -> Array:
    """Compute the RMS of errors (n, 3) along x, y and z, and its quadratic mean, (4,)."""
    each = (errors**2).mean(axis=0)
    return np.sqrt(np.append(each, each.mean()))
