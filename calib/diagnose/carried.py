"""Carried terms: what left-out readings confirm beside the named effects, without a cause that has a name.

A carried term is an effect of the group "carried": a slot of the chain times a condition, with a size by evidence. It
improves predictions; its label is no cause, since two halves of the same readings choose different terms.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.stats import hypergeom

from calib.array import Array
from calib.data.dataset import Dataset
from calib.diagnose.dictionary import bound
from calib.diagnose.pursuit import Chosen, parts, pursue
from calib.fit.identification import Identification
from calib.fit.identify import carry
from calib.fit.left_out import all_readings
from calib.fit.readings import Readings
from calib.model.effect import Effect, Owner, Parameter, Term
from calib.model.model import Design
from calib.units import to_display

_WINDOWS = np.radians((6.0, 12.0, 24.0))
_FEWEST_TOGETHER = 3  # poses
_BY_CHANCE = 1e-3
_ROUNDS = 3  # Gauss-Newton steps of the final fit: the terms are small


def with_carried(dataset: Dataset, named: Identification) -> tuple[Identification, Chosen]:
    """The fit with the terms that left-out blocks confirm beside its model; the fit itself where there are none."""
    readings = readings_back(dataset, named)
    chosen = pursue(named, readings)
    if not chosen.entries:
        return named, chosen
    return _fitted(named, readings, chosen), chosen


def readings_back(dataset: Dataset, fitted: Identification) -> Readings:
    """The readings of a fit, and those it left out that lie together in a window of one joint, beyond chance: these are
    a place where the model fails, no accidents."""
    readings, out = all_readings(dataset, fitted)
    joints, pose = readings.conditions.joints, readings.conditions.pose
    back = np.zeros(len(out), dtype=bool)
    rejected = np.flatnonzero(out)
    if len(rejected) < _FEWEST_TOGETHER:
        return fitted.readings
    for angle in joints.T:
        for width in _WINDOWS:
            if np.ptp(angle) <= 3.0 * width:
                continue
            within = (angle >= angle[rejected][:, None]) & (angle <= angle[rejected][:, None] + width)
            gone = within & out
            chance = hypergeom.sf(gone.sum(axis=1) - 1, len(out), len(rejected), within.sum(axis=1))
            chance = chance * len(rejected) * len(_WINDOWS) * joints.shape[1]
            for i in np.flatnonzero(chance < _BY_CHANCE):
                if len(np.unique(pose[gone[i]])) >= _FEWEST_TOGETHER:
                    back |= gone[i]
    return readings.take(~out | back) if back.any() else fitted.readings


def _fitted(named: Identification, readings: Readings, chosen: Chosen) -> Identification:
    """Model and terms fitted together, each term held by its evidence, on the exact chain."""
    dictionary_clock = (
        "time"
        if np.isfinite(readings.conditions.time).all() and np.ptp(readings.conditions.time) > 0.0
        else "order"
    )
    known = np.unique(getattr(readings.conditions, dictionary_clock))
    effects = effects_of(named, chosen, known, dictionary_clock)
    model = named.model.append(*effects)
    estimate = carry(named.model, named.estimate, model)
    count, start = len(named.estimate), estimate.copy()
    active = np.r_[np.diag(named.covariance) > 0.0, np.ones(len(estimate) - count, dtype=bool)]
    noise = max(named.noise_scale, 1e-9)
    weight = np.r_[named.prior, noise / model.prior_std[count:]]
    scale = noise
    for _ in range(_ROUNDS):
        weight[count:] = scale / model.prior_std[count:]
        gram = np.zeros((int(active.sum()),) * 2)
        right = np.zeros(len(gram))
        for part in parts(replace(named, model=model, estimate=estimate), readings):
            columns = part.columns[:, active]
            gram += columns.T @ columns
            right += columns.T @ part.residual.ravel()
        size = np.sqrt(np.diag(gram) + weight[active] ** 2)
        leash = np.where(np.flatnonzero(active) < count, 0.03, 0.0) * size
        held = weight[active] ** 2
        normal = gram + np.diag(held + leash**2)
        right += -held * (estimate - model.prior_mean)[active] - leash**2 * (estimate - start)[active]
        inverse = np.linalg.inv(normal / np.outer(size, size)) / np.outer(size, size)
        estimate = estimate.copy()
        estimate[active] += inverse @ right
        residual = readings.observed.residual(Design(model, readings.conditions).frames(estimate, ()))
        determined = 1.0 - (held + leash**2) * np.diag(inverse)
        freedom = readings.observed.count - round(float(determined.sum()))
        scale = float(np.sqrt(np.sum(residual**2) / max(freedom, 1)))
    covariance = np.zeros((len(estimate),) * 2)
    scale *= chosen.kappa
    covariance[np.ix_(active, active)] = inverse * max(scale, 1.0) ** 2
    return replace(
        named,
        model=model,
        estimate=estimate,
        covariance=covariance,
        prior=weight,
        readings=readings,
        residual=residual,
        noise_scale=scale,
        degrees_of_freedom=freedom,
        faulty_rows=named.faulty_rows,
    )


def effects_of(named: Identification, chosen: Chosen, known: Array, clock: str) -> tuple[Effect, ...]:
    """The chosen entries as effects of a model."""
    slots = named.model.chain.slots
    out: list[Effect] = []
    for entry, size in zip(chosen.entries, chosen.sizes, strict=True):
        unit = "deg" if slots[entry.slot].turns else "mm"
        name = f"carried:{entry.slot}:{entry.kind.replace(' ', '_')}:{len(out) + 1}"
        parameters, terms = [], []
        for i, function in enumerate(entry.functions):
            own = f"{name}.{'ab'[i]}" if len(entry.functions) > 1 else f"{name}.size"
            parameters.append(Parameter(own, unit, to_display(size, unit)))
            terms.append(Term(own, entry.slot, 1.0, bound(function, known, clock)))
        owner: Owner = "mounting" if entry.slot.partition(".")[0] in ("base", "tool") else "robot"
        meaning = f"{entry.slot} changes with {entry.condition}, for no known cause."
        out.append(Effect(name, "carried", owner, meaning, tuple(parameters), tuple(terms)))
    return tuple(out)
