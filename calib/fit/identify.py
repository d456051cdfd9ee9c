"""Identification: the parameters of the base model from a data set, with their uncertainty.

The steps are a start, the rank analysis and plain least squares. If the residual shows readings that may
have steered the fit, it starts again with Huber's weights and continues with the bisquare. Rows that do
not belong are then relabelled or rejected, and plain least squares follow on the rest. Only `fit_rows`
of the data set take part.

The usual size of compliances is that of industrial arms. Small arms have softer gears, so
`softer_than_usual` widens it. `inconsistent_distances` finds distances between balls of one body that contradict the
rest of a fit, because of another bar or a ball that moved. `refuse_misfit` refuses fits that miss the
readings, or that come out as another robot.

`refit` continues a fit with another model, from its estimate and with its readings.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.data.dataset import Dataset
from calib.data.hypotheses import reach
from calib.data.plausible import remarks
from calib.errors import DataError
from calib.fit import robust
from calib.fit.ending import FitTermination
from calib.fit.identification import IdentificationFit
from calib.fit.least_squares import (
    LEAST_NOISE,
    MAX_ITERATIONS,
    DroppedParameter,
    Linearisation,
    Solution,
    find_dependent,
    solve,
    usual_sizes,
)
from calib.fit.offsets import offsets_of
from calib.fit.placing import base_model_of
from calib.fit.readings import FitReadings, begun, readings_of
from calib.fit.type_prior import (
    TypeFit,
    TypePrior,
    farthest_from_type,
    together,
    with_type_prior,
    without_type_prior,
)
from calib.model.base_model import COMPLIANCE, adapted, named_in
from calib.model.effect import Parameter
from calib.model.model import BoundModel, ModelStructure
from calib.units import percent, to_display

Progress = Callable[[str], None]

_LOOSE = {"mm": 5.0, "deg": 0.5}  # standard error from which on a parameter is not known by itself

_UNSETTLED = 2.0  # ratio of found noise to declared above which the first steps may not have arrived

_CROWDED = (
    4.0  # ratio of noise, before and after a crowd of readings is left out, from which they are gross errors
)

_FAR = 10.0  # ratio of found noise to declared, or its inverse, that is reported

_SOFTER = 3.0  # usual sizes from which on the readings contradict the size

_ASTRAY = 5.0  # standard deviations by which a distance may miss what everything else says of it

_CLEAR = 1e-9  # of a distance that nothing else shows

_MISFIT_FAR = 0.05  # share of the extent of the measured points that a fitted robot may miss them by

_LEAST_MM = 10.0

_OTHER = 0.05  # share of the reach by which no length of a robot differs from its file

_SURE = 10.0  # standard errors of such a length

_NOISE = 10.0  # ratio of what is left to the declared noise below which the fit is no such matter


def silent(_: str) -> None:
    """Ignore the progress of a fit."""


def identify(
    dataset: Dataset,
    *,
    groups: Sequence[str] | None = None,
    prior: TypePrior | None = None,
    progress: Progress = silent,
) -> IdentificationFit:
    """Identify the base model of a data set.

    Parameters
    ----------
    dataset : Dataset
        Readings and header of one robot.
    groups : sequence of str, optional
        Parameter groups to free. Default: those of the header.
    prior : TypePrior, optional
        Prior learned from robots of the same type.
    progress : callable, optional
        Called with the name of each step.

    Returns
    -------
    IdentificationFit
        Estimate, covariance, dropped parameters and warnings.

    Raises
    ------
    DataError
        The readings do not determine the model: they are too few, or no tool target shows the last
        joint. The error is also raised if this cannot be the measured robot, and if the prior belongs to
        another type.
    """
    model = base_model_of(dataset, groups)
    if prior is None:
        refuse_too_few(dataset, model)
        start = np.zeros(len(model.parameters))
        readings, at = begun(dataset, dataset.fit_rows, model, start)
        found = fit(dataset, model, readings, start, at=at, progress=progress)
        if soft := softer_than_usual(found, named_in(model.effects, dataset.header.priors)):
            model = replace(model, effects=adapted(model.effects, (), soft))
            found = fit(dataset, model, readings, found.estimate, progress=progress)
    else:
        found = _beside_type(dataset, model, prior, progress)
    refuse_misfit(dataset, found)
    return found


def _beside_type(
    dataset: Dataset, plain: ModelStructure, prior: TypePrior, progress: Progress
) -> IdentificationFit:
    """Fit with the prior of the robot's type, without its rows that this robot contradicts."""
    header = dataset.header
    of_robot = [e.label for e in plain.effects if e.owner == "robot"]
    prior.refuse_other(header.robot, header.coupling, of_robot)
    start = np.zeros(len(plain.parameters))
    readings = readings_of(dataset, dataset.fit_rows, plain, start)
    at = Linearisation(BoundModel(plain, readings.conditions), readings.observed, start)
    model, beside = with_type_prior(at, prior, named_in(plain.effects, header.priors))
    refuse_too_few(dataset, model)

    def fitted(model: ModelStructure) -> IdentificationFit:
        return fit(dataset, model, readings, model.prior_mean, progress=progress)

    usual = {p.name: p for p in plain.parameters}
    return within_type(fitted(model), beside, usual, fitted)


def within_type(
    found: IdentificationFit,
    beside: TypeFit,
    usual: Mapping[str, Parameter],
    fitted: Callable[[ModelStructure], IdentificationFit],
) -> IdentificationFit:
    """Remove the type's prior of every parameter in which this robot lies outside its type.

    The farthest parameter comes first. If the robot is no member of the type, the whole prior is removed.

    Parameters
    ----------
    found : IdentificationFit
        Fit with the whole prior.
    beside : TypeFit
        State of the prior in this fit.
    usual : mapping of str to Parameter
        Parameters by name, as they are without the type's prior.
    fitted : callable
        Fits a model to the same readings.
    """
    while (
        stray := farthest_from_type(found.weighed, beside.prior.robots)
    ) is not None and not beside.no_member:
        beside = replace(beside, outside=(*beside.outside, stray))
        found = fitted(without_type_prior(found.model, usual, stray.name))
    square, freedom = together(found.model, found.estimate, found.covariance, 1.0 / found.held_std)
    beside = replace(beside, chi_square=square, freedom=freedom)
    if beside.no_member:
        beside = replace(beside, left_out=True)
        found = fitted(without_type_prior(found.model, usual))
    return replace(found, beside=beside, warnings=(*beside.warnings(), *found.warnings))


def carry(source: ModelStructure, estimate: Array, goal: ModelStructure) -> Array:
    """Carry an estimate over to the model `goal`, shape (m,).

    Parameters of both models keep their values, the others are zero.
    """
    out = np.zeros(len(goal.parameters))
    for name, position in goal.index.items():
        if name in source.index:
            out[position] = estimate[source.index[name]]
    return out


def fit(
    dataset: Dataset,
    model: ModelStructure,
    readings: FitReadings,
    start: Array,
    *,
    settled: tuple[DroppedParameter, ...] | None = None,
    at: Linearisation | None = None,
    progress: Progress = silent,
) -> IdentificationFit:
    """Fit any model to readings from a start.

    The fit is plain if all readings belong, and robust first if some may not.

    Parameters
    ----------
    dataset : Dataset
        Data set of the readings, for their identifiers and its header.
    model : ModelStructure
        Model to fit.
    readings : FitReadings
        Readings to fit it to.
    start : array of shape (m,)
        Start estimate, internal units.
    settled : tuple of DroppedParameter, optional
        Parameters of the base model that an earlier fit dropped; they stay dropped.
    at : Linearisation, optional
        Readings as the model sees them at the start, if already computed.
    progress : callable, optional
        Called with the name of each step.
    """
    progress("fitting")
    observed = readings.observed
    at_start = at or Linearisation(BoundModel(model, readings.conditions), observed, start)
    active, dropped = find_dependent(at_start, settled)
    near = solve(at_start, active, dropped, max_iterations=2)
    scale = robust.noise_scale(near.residual, observed.freedom)
    if (
        scale > _UNSETTLED
    ):  # perhaps only far from the start yet: a misfit that is no noise must not lend the priors weight
        near = solve(near.at, active, dropped)
        scale = robust.noise_scale(near.residual, observed.freedom)
    plain = solve(near.at, active, dropped, scale=scale)
    while (
        scale > LEAST_NOISE and (found := robust.noise_scale(plain.residual, observed.freedom)) < 0.5 * scale
    ):
        scale = found
        plain = solve(plain.at, active, dropped, scale=scale)
    alone, wrong = observed.alone, robust.FEW
    at = _without_crowd(plain, dropped)
    if at is not None:
        wrong = robust.CROWD
    elif not robust.suspicious(plain.standardised(), observed.freedom):
        return _result(dataset, model, readings, plain, active, dropped)
    else:
        progress("fitting, robust to gross errors")
        at = Linearisation(at_start.design, alone, start)
        for weigh in (robust.huber, robust.huber, robust.bisquare, robust.bisquare):
            found, weights = (
                robust.noise_scale(at.residual, observed.freedom),
                weigh(at.residual, observed.freedom),
            )
            at = solve(at, active, dropped, weights=weights, scale=min(found, scale), max_iterations=2).at
    estimate, residual = at.estimate, at.residual
    readings, relabelled = _relabel(dataset, model, readings, estimate, residual, wrong)
    if relabelled:
        frames = BoundModel(model, readings.conditions).frames(estimate, ())
        residual = alone.residual(frames)
    faulty = robust.outliers(residual, observed.freedom, wrong)
    rejected = tuple(dataset.reading_id[i] for i in readings.rows[faulty])
    readings = readings.take(~faulty)
    return fit_plain(dataset, model, readings, estimate, active, dropped, rejected, relabelled)


def _without_crowd(plain: Solution, dropped: tuple[DroppedParameter, ...]) -> Linearisation | None:
    """Find the fit on which most readings agree if up to a quarter of them are gross errors.

    Returns None if they are not. From the plain fit, weights 1 / distance come first (least absolute
    errors, which a quarter of the readings does not move far), then the bisquare. Two conditions make a
    crowd credible. The residuals of the other readings must be far smaller than those of the plain fit,
    and the crowd must be scattered. Readings that lie together in time or along a joint are a structure,
    which has a cause to be found.
    """
    observed = plain.at.observed
    freedom, before = observed.freedom, robust.noise_scale(plain.residual, observed.freedom)
    if before < _CROWDED:
        return None
    at = Linearisation(plain.at.design, observed.alone, plain.estimate)
    for weigh, wrong in ((robust.huber, 0.5),) * 10 + ((robust.bisquare, robust.CROWD),) * 4:
        found = robust.noise_scale(at.residual, freedom, wrong)
        weights = weigh(at.residual, freedom, wrong)
        at = solve(at, plain.active, dropped, weights=weights, scale=found, max_iterations=1).at
    after = robust.noise_scale(at.residual, freedom, robust.CROWD)
    out = robust.outliers(at.residual, freedom, robust.CROWD)
    if _CROWDED * after >= before or np.mean(out) >= robust.CROWD:
        return None
    conditions = plain.at.design.conditions
    _, first, visit = np.unique(conditions.visit, return_index=True, return_inverse=True)
    along = np.column_stack([conditions.order, conditions.joints])[first]
    return None if robust.lie_together(np.bincount(visit, out) > 0.0, along) else at


def fit_plain(
    dataset: Dataset,
    model: ModelStructure,
    readings: FitReadings,
    start: Array,
    active: NDArray[np.bool_],
    dropped: tuple[DroppedParameter, ...],
    faulty: tuple[str, ...] = (),
    relabelled: tuple[tuple[str, str, str], ...] = (),
    max_iterations: int = MAX_ITERATIONS,
) -> IdentificationFit:
    """Plain least squares on readings that belong; nothing is screened."""
    at = Linearisation(BoundModel(model, readings.conditions), readings.observed, start)
    solution = _solve(at, active, dropped, max_iterations)
    return _result(dataset, model, readings, solution, active, dropped, faulty, relabelled)


def _solve(
    start: Linearisation,
    active: NDArray[np.bool_],
    dropped: tuple[DroppedParameter, ...],
    max_iterations: int,
) -> Solution:
    """Solve plain least squares with priors weighed by the noise near the end, not at the start."""
    near = solve(start, active, dropped, max_iterations=2)
    scale = robust.noise_scale(near.residual, start.observed.freedom)
    return solve(near.at, active, dropped, scale=scale, max_iterations=max(max_iterations - 2, 1))


def _result(
    dataset: Dataset,
    model: ModelStructure,
    readings: FitReadings,
    solution: Solution,
    active: NDArray[np.bool_],
    dropped: tuple[DroppedParameter, ...],
    faulty: tuple[str, ...] = (),
    relabelled: tuple[tuple[str, str, str], ...] = (),
) -> IdentificationFit:
    # What a declared uncertainty or a usual size determines, wholly where the readings say nothing, costs no freedom.
    dof = readings.observed.count - int(active.sum()) + round(solution.given)
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
    warnings += inconsistent_distances(solution)
    warnings += _unused(dataset)
    warnings += remarks(dataset)
    warnings += _of_faulty(readings, faulty)
    if relabelled:
        warnings.append(
            f"{len(relabelled)} readings fit only when another tool target is assumed; relabelled."
        )
    found = IdentificationFit(
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
        ending=solution.ending,
        warnings=tuple(warnings),
        header=dataset.header,
        data_sha256=dataset.sha256,
    )
    doubted = tuple(offset.in_words() for offset in offsets_of(found) if offset.judged.doubted)
    return replace(found, warnings=(*doubted, *found.warnings))


def _warnings(
    model: ModelStructure,
    active: NDArray[np.bool_],
    dropped: tuple[DroppedParameter, ...],
    covariance: Array,
    solution: Solution,
) -> list[str]:
    out = []
    if solution.ending is not FitTermination.CONVERGED:
        out.append(f"The fit did not converge: it {solution.ending.in_words}. Do not use its parameters.")
    for drop in dropped:
        reason = (
            f"confounded with {', '.join(drop.confounded_with)}"
            if drop.confounded_with
            else "it moves nothing here"
        )
        out.append(f"{drop.name} was dropped: these readings do not determine it ({reason}).")
    spread, usual = np.sqrt(np.diag(covariance)), usual_sizes(model, dropped)
    for position, parameter in enumerate(model.parameters):
        hardly = spread[position] > 0.5 * usual[position]
        if active[position] and hardly and not model.measured[position]:
            out.append(f"{parameter.name} is hardly seen by these readings; its usual size holds it.")
    return [*out, *_only_together(model, active & ~(spread > 0.5 * usual), spread)]


def _only_together(model: ModelStructure, active: NDArray[np.bool_], spread: Array) -> list[str]:
    """Warn about parameters that compensate each other along a nearly flat direction."""
    units = [parameter.unit for parameter in model.parameters]
    loose = [
        k
        for k, unit in enumerate(units)
        if active[k] and unit in _LOOSE and to_display(float(spread[k]), unit) > _LOOSE[unit]
    ]
    if len(loose) < 2:
        return []
    most = {unit: max(spread[k] for k in loose if units[k] == unit) for unit in {units[k] for k in loose}}
    sizes = " and ".join(
        f"{float(f'{to_display(float(most[unit]), unit):.2g}'):g} {unit}"
        for unit in sorted(most, reverse=True)
    )
    names = ", ".join(model.parameters[k].name for k in loose)
    return [
        f"{names} are seen together only, none of them by itself: their standard errors go up to {sizes}. Points that "
        "do not lie in a line, and poses that turn the tool about other axes, tell them apart."
    ]


def _of_faulty(readings: FitReadings, faulty: tuple[str, ...]) -> list[str]:
    """Return a remark on the number of readings that were left out, if any were."""
    if not faulty:
        return []
    share = len(faulty) / (len(faulty) + len(readings.rows))
    many = f"{len(faulty)} readings" if len(faulty) > 1 else "1 reading"
    return [f"{many} ({percent(share, 1)}) outside what the model and the noise allow: left out."]


def leaving_out(
    fitted: IdentificationFit, readings: FitReadings, faulty: tuple[str, ...]
) -> IdentificationFit:
    """Replace the readings of a fit that is to be repeated, the faulty ones left out."""
    before = _of_faulty(fitted.readings, fitted.faulty_rows)
    warnings = (*(w for w in fitted.warnings if w not in before), *_of_faulty(readings, faulty))
    return replace(fitted, readings=readings, faulty_rows=faulty, warnings=warnings)


def _unused(dataset: Dataset) -> list[str]:
    """List remarks on parts of the files that take no part in the fit."""
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
    dataset: Dataset,
    model: ModelStructure,
    readings: FitReadings,
    estimate: Array,
    residual: Array,
    wrong: float,
) -> tuple[FitReadings, tuple[tuple[str, str, str], ...]]:
    """Relabel readings that do not fit, each for itself, but do with another tool target."""
    conditions = readings.conditions
    suspects = np.flatnonzero(robust.outliers(residual, readings.observed.freedom, wrong))
    limit = robust.threshold(residual, readings.observed.freedom, wrong)
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
        frames = BoundModel(model, few.conditions).frames(estimate, ())
        fits = robust.distances(few.observed.alone.residual(frames)) < limit[trial]
        for i in trial[fits]:
            if target[i] == conditions.target[i] != t:
                target[i] = t
                reading = dataset.reading_id[readings.rows[i]]
                relabelled.append((reading, conditions.target_names[conditions.target[i]], name))
    if not relabelled:
        return readings, ()
    return replace(readings, conditions=replace(conditions, target=target)), tuple(relabelled)


def refuse_too_few(dataset: Dataset, model: ModelStructure) -> None:
    """Raise DataError when the readings cannot carry the model."""
    rows = dataset.fit_rows
    unknowns = int(np.sum(~model.measured))  # what is known to an uncertainty brings its own number
    if dataset.numbers <= unknowns:
        raise DataError(
            f"has {int(rows.sum())} calibration readings ({dataset.numbers} numbers) for {unknowns} parameters.",
            do=f"Measure numbers for at least {unknowns + 30}, or free fewer groups under [model] fit.",
            file=dataset.path,
            key="set",
        )
    last = f"theta{model.robot.joints}"
    tool = [p for e in model.effects if "target" in e.places for p in e.parameters]
    if last in model.index and not any(p.size is None for p in tool) and last_joint_unseen(dataset):
        raise DataError(
            "all readings were taken with tool targets on the axis of the last joint, whose turning they cannot see.",
            do="Measure a second target, some 50 mm or more off that axis. Otherwise accept that the last joint "
            f'keeps its nominal zero, with hold = ["{last}"] under [model].',
            file=dataset.path,
            key="tool_targets",
        )


def last_joint_unseen(dataset: Dataset) -> bool:
    """Test whether all points measured for a fit lie on the axis of the last joint.

    The turning of that joint then moves nothing.
    """
    rows = dataset.fit_rows
    if (rows & dataset.turned).any():
        return False
    conditions = dataset.conditions
    names = conditions.target_names
    seen = np.flatnonzero(
        np.bincount(conditions.series[rows] * len(names) + conditions.target[rows])
    ).tolist()
    off_axis = [
        np.hypot(
            *dataset.header.targets_of(conditions.series_names[i // len(names)])[names[i % len(names)]][:2]
        )
        for i in seen
    ]
    return bool(max(off_axis) < 1.0)


def softer_than_usual(found: IdentificationFit, told: Collection[str]) -> dict[str, float]:
    """Find the gears whose compliance contradicts its usual size, as in small arms.

    Parameters
    ----------
    found : IdentificationFit
        Fit with the usual sizes.
    told : collection of str
        Parameters whose size the header gives.

    Returns
    -------
    dict of str to float
        By parameter name, a size that no longer constrains it, in its unit.
    """
    soft = {}
    for p, value in zip(found.model.parameters, found.estimate, strict=True):
        shown = to_display(float(value), p.unit)
        if p.size and p.unit == COMPLIANCE and p.name not in told and shown > _SOFTER * p.size:
            soft[p.name] = _SOFTER * shown
    return soft


def inconsistent_distances(solution: Solution) -> list[str]:
    """Find ball-to-ball distances that contradict readings and stated positions, worst first.

    If one distance is left out, the fit misses it by r / (1 - h), with the variance 1 / (1 - h), where h
    is its leverage. A distance that fails no longer counts in the test of the others, so that it does
    not accuse them. Returns one sentence for each.
    """
    spans, missed = solution.at.design.model.spans, solution.at.tied[0].copy()
    hat = solution.tied @ solution.covariance @ solution.tied.T
    said, left = [], set(range(len(spans)))
    while left:
        free = np.maximum(1.0 - np.diag(hat), _CLEAR)
        worst = max(left, key=lambda k: abs(missed[k]) / np.sqrt(free[k]))
        off, sigma = missed[worst] / free[worst], abs(missed[worst]) / np.sqrt(free[worst])
        if sigma <= _ASTRAY:
            break
        span = spans[worst]
        said.append(
            f"The distance {span.name} (reading {span.reading_id}, {span.length_mm:.4f} mm) is "
            f"{off * span.u_mm:+.3f} mm from what everything else says, {sigma:.0f} standard deviations: "
            "measure it again."
        )
        left.remove(worst)
        missed = missed + hat[:, worst] * off
        hat = hat + np.outer(hat[:, worst], hat[worst]) / free[worst]
    return said


def refuse_misfit(dataset: Dataset, found: IdentificationFit) -> None:
    """Raise DataError if the fitted robot misses the points, or is another robot.

    The robot misses the points if the median error exceeds a twentieth of their extent. It is another
    robot if a length comes out different.

    Errors that one change of the files explains were refused before (`calib.data.plausible`). A zero
    that is 30 deg off, which nothing there explains, is fitted and passes. If zeros are not freed, such
    as by `fit = ["base"]`, a far miss may be the very finding, and nothing is refused.
    """
    _refuse_other_lengths(dataset, found)
    zeros = set(found.model.robot.joint_slots)
    if found.noise_scale < _NOISE or not zeros & found.model.index.keys():
        return
    points = dataset.points[found.readings.rows]
    pointed = np.isfinite(points[:, 0])
    if not pointed.any():
        return
    points = points[pointed]
    predicted = found.predict(found.readings.conditions.take(pointed))
    miss = float(np.median(np.linalg.norm(points - predicted, axis=1)))
    extent = float(np.linalg.norm(np.std(points, axis=0)))
    if miss <= max(_MISFIT_FAR * extent, _LEAST_MM):
        return
    raise DataError(
        f"the robot '{dataset.header.robot.name}' does not fit these readings: with its parameters fitted it still "
        f"misses half of them by {miss:.3g} mm or more, and the points spread by {extent:.3g} mm.",
        do="Check whether it is this robot; then its file, the order, signs and zeros of the joint columns, and that "
        "every row holds joints and point of one moment.",
        file=dataset.path.with_suffix(".toml"),
        key="robot",
    )


def _refuse_other_lengths(dataset: Dataset, found: IdentificationFit) -> None:
    robot = found.model.robot
    far = _OTHER * reach(robot)
    columns = {f"{key}{k + 1}": (key, k) for key in "ad" for k in range(robot.joints)}
    beyond = [
        (name, getattr(robot, columns[name][0])[columns[name][1]], found.estimate[i])
        for name, i in found.model.index.items()
        if name in columns and abs(found.estimate[i]) > max(far, _SURE * found.standard_errors[i])
    ]
    if beyond:
        told = ", ".join(
            f"{name} = {nominal + change:.0f} mm instead of {nominal:.0f}" for name, nominal, change in beyond
        )
        raise DataError(
            f"the robot '{robot.name}' is not that of these readings: they would have {told}.",
            do="Name the robot that was measured, or correct the lengths in its robot file.",
            file=dataset.path.with_suffix(".toml"),
            key="robot",
        )


def fit_again(dataset: Dataset, fitted: IdentificationFit, model: ModelStructure) -> IdentificationFit:
    """Fit another model to the readings of a fit, from its estimate.

    The model has the same parameters. Readings that took no part still take none.
    """
    return fit_plain(
        dataset,
        model,
        fitted.readings,
        fitted.estimate,
        np.diag(fitted.covariance) > 0.0,
        fitted.dropped,
        fitted.faulty_rows,
        fitted.relabelled_rows,
    )
