"""Identification: from a data set to the parameters of its base model, with what is known about them.

start -> nominal robot in its place -> rank analysis -> Huber -> bisquare -> rows that do not belong are relabelled
or rejected -> plain least squares on the rest. Only `fit_rows` of the data set take part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib import robust
from calib.conditions import Conditions
from calib.dataset import Dataset
from calib.effects import base_model
from calib.errors import DataError
from calib.header import Header
from calib.kinematics import Array, forward
from calib.least_squares import MAX_ITERATIONS, Dropped, Solution, find_dependent, solve
from calib.model import Design, RobotModel
from calib.noise import whitener
from calib.observations import Points
from calib.start import base_and_tool

Progress = Callable[[str], None]


def silent(_: str) -> None:
    """A progress callback that says nothing."""


@dataclass(frozen=True)
class Readings:
    """The readings of a fit: conditions, whitened points and their place in the data set."""

    conditions: Conditions
    points: Points
    rows: NDArray[np.int64]

    def take(self, keep: NDArray[np.bool_]) -> Readings:
        """Some of the readings, by mask (n,)."""
        points = Points(self.points.measured[keep], np.ascontiguousarray(self.points.whiten[:, :, keep]))
        return Readings(self.conditions.take(keep), points, self.rows[keep])


@dataclass(frozen=True)
class Identification:
    """What was found: immutable; everything else (report, prediction, export) is a function of it.

    estimate (m,) and covariance (m, m) in internal units, the covariance for the noise that was found (declared
    noise x noise_scale, where that is above 1); `readings` are those that took part.
    """

    model: RobotModel
    estimate: Array
    covariance: Array
    dropped: tuple[Dropped, ...]
    readings: Readings
    residual: Array  # (3, n) whitened with the declared noise
    prior: Array  # (m,) weight of the prior of every parameter, in whitened units
    noise_scale: float
    degrees_of_freedom: int
    faulty_rows: tuple[str, ...]
    relabelled_rows: tuple[tuple[str, str, str], ...]
    iterations: int
    converged: bool
    warnings: tuple[str, ...]
    header: Header
    data_sha256: str

    @property
    def standard_errors(self) -> Array:
        """(m,) internal units."""
        return np.sqrt(np.diag(self.covariance))

    def predict(self, conditions: Conditions) -> Array:
        """(n, 3) points as the instrument would read them, mm."""
        return Design(self.model, conditions).predict(self.estimate)


def readings_of(dataset: Dataset, rows: NDArray[np.bool_], model: RobotModel, estimate: Array) -> Readings:
    """Whitened readings of some rows; the repeatability enters at the joint Jacobian of `model`."""
    conditions = dataset.conditions.take(rows)
    frames = Design(model, conditions).frames(estimate)
    noise = dataset.header.noise
    covariance = dataset.covariance(rows) + noise.of_repeatability(frames, model.robot.joints)
    return Readings(conditions, Points(dataset.points[rows], whitener(covariance)), np.flatnonzero(rows))


def base_model_of(dataset: Dataset, groups: Sequence[str] | None = None) -> RobotModel:
    """The model that the header frees, with a start for the base of every series."""
    header, conditions = dataset.header, dataset.conditions
    groups = header.groups if groups is None else groups
    targets = {name: header.targets_of(name) for name in conditions.series_names}
    placements: dict[str, Array] = {}
    measured_in = []
    flange = forward(header.robot, conditions.joints)
    for s, name in enumerate(conditions.series_names):
        rows = dataset.fit_rows & (conditions.series == s)
        seen = sorted({conditions.target_names[t] for t in conditions.target[rows]})
        measured_in.append(seen)
        if header.world == "nominal" or not rows.any():
            continue
        nominal = np.array([targets[name].get(t, (0.0, 0.0, 0.0)) for t in conditions.target_names])
        which = conditions.target[rows]
        pose, tool = base_and_tool(
            flange[rows], nominal, which, dataset.points[rows], tool_unknown="tool" in groups
        )
        placements[name] = pose
        if "tool" in groups:
            found = {t: tuple(tool[i]) for i, t in enumerate(conditions.target_names) if t in seen}
            targets[name] = {**targets[name], **found}  # type: ignore[dict-item]
    effects = base_model.build(groups, header.robot, conditions.series_names, measured_in)
    return RobotModel(header.robot, effects, targets, placements, header.noise.station_mm)


def place_nominal(dataset: Dataset, model: RobotModel) -> tuple[RobotModel, Array]:
    """The nominal robot in its place: base (and tool, where freed) fitted, nothing else. Returns model and estimate."""
    placed = replace(
        model, effects=tuple(e for e in model.effects if e.label.partition("[")[0] in ("base", "tool"))
    )
    start = np.zeros(len(placed.parameters))
    readings = readings_of(dataset, dataset.fit_rows, placed, start)
    design = Design(placed, readings.conditions)
    active, _ = find_dependent(design, readings.points, start)
    residual = points_residual(design, readings, start)
    for _ in range(2):
        solution = solve(design, readings.points, start, active, robust.huber(residual))
        start, residual = solution.estimate, solution.residual
    return placed, start


def points_residual(design: Design, readings: Readings, estimate: Array) -> Array:
    """(3, n) whitened residual at an estimate."""
    return readings.points.residual(design.frames(estimate))


def identify(
    dataset: Dataset, *, groups: Sequence[str] | None = None, progress: Progress = silent
) -> Identification:
    """Identify the base model of a data set.

    groups: which groups to free, default those of the header. Raises DataError when the readings cannot carry
    the model (too few, or tool targets that cannot show the last joint).
    """
    model = base_model_of(dataset, groups)
    refuse_too_few(dataset, model)
    progress("placing the nominal robot")
    placed, placed_estimate = place_nominal(dataset, model)
    start = carry(placed, placed_estimate, model)
    readings = readings_of(dataset, dataset.fit_rows, model, start)
    return fit(dataset, model, readings, start, progress=progress)


def carry(source: RobotModel, estimate: Array, goal: RobotModel) -> Array:
    """Estimate (m,) for `goal`: values of the parameters both models have, zero elsewhere."""
    out = np.zeros(len(goal.parameters))
    for name, position in goal.index.items():
        if name in source.index:
            out[position] = estimate[source.index[name]]
    return out


def fit(
    dataset: Dataset,
    model: RobotModel,
    readings: Readings,
    start: Array,
    *,
    settled: tuple[Dropped, ...] | None = None,
    progress: Progress = silent,
) -> Identification:
    """Fit any model to readings from a start: robust first, then plain least squares on what belongs.

    settled: what an earlier fit dropped of the base model, which then stands.
    """
    progress("fitting, robust to gross errors")
    design = Design(model, readings.conditions)
    active, dropped = find_dependent(design, readings.points, start, settled)
    estimate, residual = start, points_residual(design, readings, start)
    for weigh in (robust.huber, robust.huber, robust.bisquare, robust.bisquare):
        scale, weights = robust.noise_scale(residual), weigh(residual)
        solution = solve(design, readings.points, estimate, active, weights, scale, max_iterations=1)
        estimate, residual = solution.estimate, solution.residual
    progress("fitting")
    readings, relabelled = _relabel(dataset, model, readings, estimate, residual)
    if relabelled:
        residual = points_residual(Design(model, readings.conditions), readings, estimate)
    faulty = robust.outliers(residual)
    rejected = tuple(dataset.reading_id[i] for i in readings.rows[faulty])
    readings = readings.take(~faulty)
    return fit_plain(dataset, model, readings, estimate, active, dropped, rejected, relabelled)


def fit_plain(
    dataset: Dataset,
    model: RobotModel,
    readings: Readings,
    start: Array,
    active: NDArray[np.bool_],
    dropped: tuple[Dropped, ...],
    faulty: tuple[str, ...] = (),
    relabelled: tuple[tuple[str, str, str], ...] = (),
    max_iterations: int = MAX_ITERATIONS,
) -> Identification:
    """Plain least squares on readings that belong; nothing is screened."""
    design = Design(model, readings.conditions)
    scale = robust.noise_scale(points_residual(design, readings, start))
    solution = solve(design, readings.points, start, active, scale=scale, max_iterations=max_iterations)
    return _result(dataset, model, readings, solution, active, dropped, faulty, relabelled)


def _result(
    dataset: Dataset,
    model: RobotModel,
    readings: Readings,
    solution: Solution,
    active: NDArray[np.bool_],
    dropped: tuple[Dropped, ...],
    faulty: tuple[str, ...],
    relabelled: tuple[tuple[str, str, str], ...],
) -> Identification:
    dof = solution.residual.size - int(active.sum())
    scale = float(np.sqrt(np.sum(solution.residual**2) / max(dof, 1)))
    covariance = solution.covariance * max(scale, 1.0) ** 2
    warnings = list(_warnings(model, active, dropped, covariance, solution))
    if faulty:
        share = len(faulty) / (len(faulty) + len(readings.rows))
        many = f"{len(faulty)} readings" if len(faulty) > 1 else "1 reading"
        warnings.append(f"{many} ({share:.1%}) outside what the model and the noise allow: left out.")
    if relabelled:
        warnings.append(
            f"{len(relabelled)} readings fit only when another tool target is assumed; relabelled."
        )
    return Identification(
        model=model,
        estimate=solution.estimate,
        covariance=covariance,
        dropped=dropped,
        readings=readings,
        residual=solution.residual,
        prior=solution.prior,
        noise_scale=scale,
        degrees_of_freedom=dof,
        faulty_rows=faulty,
        relabelled_rows=relabelled,
        iterations=solution.iterations,
        converged=solution.converged,
        warnings=tuple(warnings),
        header=dataset.header,
        data_sha256=dataset.sha256,
    )


def _warnings(
    model: RobotModel,
    active: NDArray[np.bool_],
    dropped: tuple[Dropped, ...],
    covariance: Array,
    solution: Solution,
) -> list[str]:
    out = []
    if not solution.converged:
        out.append("The fit did not converge; do not use its parameters.")
    for drop in dropped:
        reason = (
            f"confounded with {', '.join(drop.confounded_with)}"
            if drop.confounded_with
            else "it moves nothing here"
        )
        out.append(f"{drop.name} was dropped: these readings cannot tell it ({reason}).")
    spread = np.sqrt(np.diag(covariance))
    for position, parameter in enumerate(model.parameters):
        if active[position] and spread[position] > 0.5 * model.prior_std[position]:
            out.append(f"{parameter.name} is hardly seen by these readings; its usual size holds it.")
    return out


def _relabel(
    dataset: Dataset, model: RobotModel, readings: Readings, estimate: Array, residual: Array
) -> tuple[Readings, tuple[tuple[str, str, str], ...]]:
    """Readings that do not fit, but do with another tool target: relabel them."""
    conditions = readings.conditions
    suspects = np.flatnonzero(robust.outliers(residual))
    limit = robust.threshold(residual)
    target = conditions.target.copy()
    relabelled = []
    for t, name in enumerate(conditions.target_names):
        known = np.array(
            [name in model.targets[conditions.series_names[s]] for s in conditions.series[suspects]]
        )
        trial = suspects[known] if len(suspects) else suspects
        if not len(trial):
            continue
        few = readings.take(np.isin(np.arange(len(conditions)), trial))
        few = replace(few, conditions=replace(few.conditions, target=np.full(len(trial), t)))
        fits = robust.distances(points_residual(Design(model, few.conditions), few, estimate)) < limit
        for i in trial[fits]:
            if target[i] == conditions.target[i] != t:
                target[i] = t
                reading = dataset.reading_id[readings.rows[i]]
                relabelled.append((reading, conditions.target_names[conditions.target[i]], name))
    if not relabelled:
        return readings, ()
    return replace(readings, conditions=replace(conditions, target=target)), tuple(relabelled)


def refuse_too_few(dataset: Dataset, model: RobotModel) -> None:
    """Raise DataError when the readings cannot carry the model."""
    rows = dataset.fit_rows
    unknowns = len(model.parameters)
    if 3 * int(rows.sum()) <= unknowns:
        raise DataError(
            f"has {int(rows.sum())} calibration readings (three numbers each) for {unknowns} parameters.",
            do=f"Measure at least {unknowns // 3 + 10} poses, or free fewer groups under [model] fit.",
            file=dataset.path,
            key="set",
        )
    if "geometry" not in [e.label for e in model.effects]:
        return
    conditions = dataset.conditions.take(rows)
    off_axis = [
        np.hypot(*model.targets[conditions.series_names[s]][conditions.target_names[t]][:2])
        for s, t in {(int(s), int(t)) for s, t in zip(conditions.series, conditions.target, strict=True)}
    ]
    if max(off_axis) < 1.0 and not any(e.label.startswith("tool") for e in model.effects):
        raise DataError(
            "all readings were taken with tool targets on the axis of the last joint, whose turning they cannot see.",
            do="Measure a second target, some 50 mm or more off that axis, or leave 'geometry' out of [model] fit.",
            file=dataset.path,
            key="tool_targets",
        )
