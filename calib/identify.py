"""Identification: from a data set to the parameters of its base model, with what is known about them.

start -> rank analysis -> plain least squares. Where its residual shows readings that may have steered it: from the
start again with Huber's weights, then the bisquare; rows that do not belong are relabelled or rejected; plain least
squares on the rest. Only `fit_rows` of the data set take part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib import robust
from calib.dataset import Dataset
from calib.errors import DataError
from calib.identification import Identification
from calib.kinematics import Array
from calib.least_squares import LEAST_NOISE, MAX_ITERATIONS, Dropped, Solution, find_dependent, solve
from calib.model import Design, RobotModel
from calib.observations import Observations
from calib.placing import base_model_of
from calib.plausible import remarks
from calib.readings import Readings, readings_of

Progress = Callable[[str], None]

_FAR = 10.0  # ratio of found noise to declared, or its inverse, that is told


def silent(_: str) -> None:
    """A progress callback that says nothing."""


def identify(
    dataset: Dataset, *, groups: Sequence[str] | None = None, progress: Progress = silent
) -> Identification:
    """Identify the base model of a data set.

    groups: which groups to free, default those of the header. Raises DataError when the readings cannot carry
    the model (too few, or tool targets that cannot show the last joint).
    """
    model = base_model_of(dataset, groups)
    refuse_too_few(dataset, model)
    start = np.zeros(len(model.parameters))
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
    """Fit any model to readings from a start: plain where all readings belong, robust first where some may not.

    settled: what an earlier fit dropped of the base model, which then stands.
    """
    progress("fitting")
    design = Design(model, readings.conditions)
    observed = readings.observed
    active, dropped = find_dependent(design, observed, start, settled)
    near = solve(design, observed, start, active, max_iterations=2)
    scale = robust.noise_scale(near.residual, observed.freedom)
    if (
        scale > _FAR
    ):  # perhaps only far from the start yet: a misfit that is no noise must not lend the priors weight
        near = solve(design, observed, near.estimate, active)
        scale = robust.noise_scale(near.residual, observed.freedom)
    plain = solve(design, observed, near.estimate, active, scale=scale)
    while (
        scale > LEAST_NOISE and (found := robust.noise_scale(plain.residual, observed.freedom)) < 0.5 * scale
    ):
        scale = found
        plain = solve(design, observed, plain.estimate, active, scale=scale)
    if not robust.suspicious(plain.standardised(), observed.freedom):
        return _result(dataset, model, readings, plain, active, dropped)
    progress("fitting, robust to gross errors")
    estimate, residual = start, observed.residual(design.frames(start, ()))
    for weigh in (robust.huber, robust.huber, robust.bisquare, robust.bisquare):
        found, weights = robust.noise_scale(residual, observed.freedom), weigh(residual, observed.freedom)
        solution = solve(design, observed, estimate, active, weights, min(found, scale), max_iterations=2)
        estimate, residual = solution.estimate, solution.residual
    readings, relabelled = _relabel(dataset, model, readings, estimate, residual)
    if relabelled:
        frames = Design(model, readings.conditions).frames(estimate, ())
        residual = observed.residual(frames)
    faulty = robust.outliers(residual, observed.freedom)
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
    design, observed = Design(model, readings.conditions), readings.observed
    solution = _solve(design, observed, start, active, max_iterations)
    return _result(dataset, model, readings, solution, active, dropped, faulty, relabelled)


def _solve(
    design: Design, observed: Observations, start: Array, active: NDArray[np.bool_], max_iterations: int
) -> Solution:
    """Plain least squares, the priors weighed with the noise that is left near the end, not at the start."""
    near = solve(design, observed, start, active, max_iterations=2)
    scale = robust.noise_scale(near.residual, observed.freedom)
    return solve(
        design, observed, near.estimate, active, scale=scale, max_iterations=max(max_iterations - 2, 1)
    )


def _result(
    dataset: Dataset,
    model: RobotModel,
    readings: Readings,
    solution: Solution,
    active: NDArray[np.bool_],
    dropped: tuple[Dropped, ...],
    faulty: tuple[str, ...] = (),
    relabelled: tuple[tuple[str, str, str], ...] = (),
) -> Identification:
    # What a declared uncertainty determines, wholly where the readings say nothing, costs them no freedom.
    share = np.diag(solution.covariance) * solution.prior**2
    dof = readings.observed.count - int(active.sum()) + round(float(share[model.measured].sum()))
    scale = float(np.sqrt(np.sum(solution.residual**2) / max(dof, 1)))
    covariance = solution.covariance * max(scale, 1.0) ** 2
    warnings = list(_warnings(model, active, dropped, covariance, solution))
    if not 1.0 / _FAR < scale < _FAR:
        why = (
            "the model lacks something, or [noise] is too small"
            if scale > 1.0
            else "[noise] is far too large"
        )
        warnings.append(f"The residuals are {scale:.2g} times the declared noise: {why}; look at its units.")
    warnings += _unused(dataset)
    warnings += remarks(dataset)
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
        hardly = spread[position] > 0.5 * model.prior_std[position]
        if active[position] and hardly and not model.measured[position]:
            out.append(f"{parameter.name} is hardly seen by these readings; its usual size holds it.")
    return out


def _unused(dataset: Dataset) -> list[str]:
    """What stands in the files and takes no part."""
    header = dataset.header
    out = [f"The header's key '{key}' is not known and was passed over." for key in header.unknown_keys]
    idle_series = sorted(set(header.series_targets) - set(dataset.conditions.series_names))
    out += [f"The header's series '{name}' has no readings." for name in idle_series]
    idle = int(np.sum(np.isfinite(dataset.orientation[:, 0]) & ~dataset.turned))
    if idle:
        out.append(
            f"{idle} orientations were not used: [noise] declares no rotation_mrad, so nobody knows their worth."
        )
    return out


def _relabel(
    dataset: Dataset, model: RobotModel, readings: Readings, estimate: Array, residual: Array
) -> tuple[Readings, tuple[tuple[str, str, str], ...]]:
    """Readings that do not fit, but do with another tool target: relabel them."""
    conditions = readings.conditions
    suspects = np.flatnonzero(robust.outliers(residual, readings.observed.freedom))
    limit = robust.threshold(residual, readings.observed.freedom)
    target = conditions.target.copy()
    relabelled = []
    for t, name in enumerate(conditions.target_names):
        known = np.array(
            [name in model.targets[conditions.series_names[s]] for s in conditions.series[suspects]]
        )
        trial = suspects[known] if len(suspects) else suspects
        if not len(trial):
            continue
        few = readings.taken(trial)
        few = replace(few, conditions=replace(few.conditions, target=np.full(len(trial), t)))
        frames = Design(model, few.conditions).frames(estimate, ())
        fits = robust.distances(few.observed.residual(frames)) < limit[trial]
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
    if dataset.numbers <= unknowns:
        raise DataError(
            f"has {int(rows.sum())} calibration readings ({dataset.numbers} numbers) for {unknowns} parameters.",
            do=f"Measure numbers for at least {unknowns + 30}, or free fewer groups under [model] fit.",
            file=dataset.path,
            key="set",
        )
    if "geometry" not in [e.label for e in model.effects] or (rows & dataset.turned).any():
        return
    conditions = dataset.conditions.take(rows)
    off_axis = [
        np.hypot(*model.targets[conditions.series_names[s]][conditions.target_names[t]][:2])
        for s, t in np.unique(np.column_stack([conditions.series, conditions.target]), axis=0)
    ]
    if max(off_axis) < 1.0 and not any(e.label.startswith("tool") for e in model.effects):
        raise DataError(
            "all readings were taken with tool targets on the axis of the last joint, whose turning they cannot see.",
            do="Measure a second target, some 50 mm or more off that axis, or leave 'geometry' out of [model] fit.",
            file=dataset.path,
            key="tool_targets",
        )
