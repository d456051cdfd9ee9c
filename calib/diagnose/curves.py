"""What the named effects leave on a joint's angle: a curve, where blocks of readings that were left out get better.

Waves describe gears; teeth, bearings and cables are local. Where structure is left, whatever drives it, and the
readings are many, a joint gets a `gear_curve` beside its named effects, which stay as they were found: fitted
together, waves and curves would trade large amounts that cancel where readings are and nowhere else (on a UR10, 7 mm
on a block that was left out, against 0.08). A curve stays only when it passes the F test and when its gain, summed
over left-out stretches of the campaign, is positive: what does not carry over is not added.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from calib import robust
from calib.dataset import Dataset
from calib.diagnose.blocks import Blocks, carried_gains
from calib.diagnose.evidence import CLAIM, p_value
from calib.diagnose.select import Selection
from calib.diagnose.space import Space
from calib.diagnose.structure import Structure
from calib.effects import Survey
from calib.effects.effect import Effect
from calib.effects.gear_curve import curve_for
from calib.identification import Identification
from calib.identify import Progress, carry, fit_plain, silent
from calib.model import Design
from calib.readings import Readings, readings_of

_STEPS = 4


def with_curves(
    dataset: Dataset, selection: Selection, structure: list[Structure], *, progress: Progress = silent
) -> Selection:
    """The selection with a curve on every joint that left-out blocks confirm, where structure is left at all."""
    survey = Survey.of(selection.fitted, dataset)
    joints = survey.joint_numbers if structure else ()
    curves = tuple(curve for k in joints if (curve := curve_for(survey, k)) is not None)
    if not curves:
        return selection
    progress(f"curves over the angle of {len(curves)} joints")
    named = selection.fitted
    trial = _fit(dataset, named, curves, named.readings)
    kept = _carrying(trial, curves)
    if not kept:
        return selection
    final = _fit(dataset, named, kept, _belonging(dataset, trial))
    return Selection(_together(named, final), (*selection.effects, *kept))


def _fit(
    dataset: Dataset, named: Identification, curves: tuple[Effect, ...], readings: Readings
) -> Identification:
    """The curves on what `named` leaves, everything else held."""
    model = named.model.append(*curves)
    start = carry(named.model, named.estimate, model)
    active = np.array([parameter.name not in named.model.index for parameter in model.parameters])
    left_out = dataset.fit_rows.copy()
    left_out[readings.rows] = False
    rejected = tuple(dataset.reading_id[i] for i in np.flatnonzero(left_out))
    return fit_plain(
        dataset, model, readings, start, active, named.dropped, rejected, named.relabelled_rows, _STEPS
    )


def _together(named: Identification, curved: Identification) -> Identification:
    """The curves' fit, with what the fit before knows of everything else."""
    count = len(named.estimate)
    covariance, prior = curved.covariance.copy(), curved.prior.copy()
    covariance[:count, :count] = named.covariance * (curved.noise_scale / named.noise_scale) ** 2
    prior[:count] = named.prior
    spent = int(np.count_nonzero(np.diag(named.covariance)))
    freedom = curved.degrees_of_freedom - spent
    scale = curved.noise_scale * float(np.sqrt(curved.degrees_of_freedom / freedom))
    warnings = tuple(dict.fromkeys((*named.warnings, *curved.warnings)))
    return replace(
        curved,
        covariance=covariance,
        prior=prior,
        degrees_of_freedom=freedom,
        noise_scale=scale,
        warnings=warnings,
    )


def _carrying(fitted: Identification, curves: tuple[Effect, ...]) -> tuple[Effect, ...]:
    """The curves that pass by themselves and that left-out blocks confirm."""
    space = Space.of(fitted)
    gains = carried_gains(space, curves, Blocks.of(space)).sum(axis=1)
    kept = []
    for curve, carried in zip(curves, gains, strict=True):
        _, coefficients = space.own_direction(curve)
        gain, columns = float(coefficients @ coefficients), len(coefficients)
        chance = p_value(gain, columns, space.rss + gain, space.freedom + columns, len(curves))
        if chance < CLAIM and carried > 0.0:
            kept.append(curve)
    return tuple(kept)


def _belonging(dataset: Dataset, fitted: Identification) -> Readings:
    """All readings that the wider model can place: some that only a curve explains had been left out."""
    readings = readings_of(dataset, dataset.fit_rows, fitted.model, fitted.estimate)
    target = readings.conditions.target.copy()
    target[np.searchsorted(readings.rows, fitted.readings.rows)] = fitted.readings.conditions.target
    readings = replace(readings, conditions=replace(readings.conditions, target=target))
    frames = Design(fitted.model, readings.conditions).frames(fitted.estimate, ())
    residual = readings.observed.residual(frames)
    return readings.take(~robust.outliers(residual, readings.observed.freedom))
