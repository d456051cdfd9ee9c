"""Detectability of the hidden effects of a data set, from the simulator's truth alone.

It is computed before any diagnosis. J is the whitened Jacobian of the base model, and of the true columns of all
other hidden effects. P is the projection on the complement of J. X beta is the whitened displacement that an effect
causes without noise. Then:

    lambda = |P X beta|^2                  what the data can show of it;
    gap    = lambda - max over rivals      what its best rival in the library, at its best place, does not explain;
    ideal  = held-out error of the fit with the true columns of all effects added.

The Jacobian is taken at the fit of the same readings without the hidden effects. An effect with several amplitudes
has one true column each. Rivals are all other labels, and periodic errors with every whole order. Half an order is
no rival, since it fits like any slope over a joint.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib import Dataset, IdentificationFit, identify
from calib.array import Array
from calib.effects import Survey, offers
from calib.model import BoundModel
from calib.scan import Family, Scores, Space
from calib.scan.families import HarmonicScores, StepScores
from mocks.campaign import Campaign
from mocks.world import Effect, World, displacement


@dataclass(frozen=True)
class Shown:
    """Detectability of one hidden effect.

    `rival` is the label of the best rival, `share` the share of lambda that it explains.
    """

    label: str
    size: float  # lambda
    gap: float
    rival: str
    share: float


@dataclass(frozen=True)
class Truth:
    """Hidden effects of a data set, and the RMS held-out error of the ideal fit.

    The error is in mm, and nan without validation rows.
    """

    effects: tuple[Shown, ...]
    ideal: float


def truth_of(campaign: Campaign, data: Dataset) -> Truth:
    """Compute the detectability of the effects in `data`, read from the files of `campaign`."""
    effects = hidden_in(campaign)
    columns = [true_columns(campaign.world, effect, campaign) for effect in effects]
    moved = sum((c.sum(axis=2) for c in columns), np.zeros((len(data), 3)))
    base = identify(replace(data, points=data.points - moved))
    space = Space.of(base)
    library = offers(Survey.of(base, data))
    whitened = [_whitened(base, c) for c in columns]
    shown = []
    for i, effect in enumerate(effects):
        others = [w for j, w in enumerate(whitened) if j != i]
        shown.append(shown_beside(space, library, effect.label, whitened[i].sum(axis=1), others))
    return Truth(tuple(shown), _ideal(data, moved, space, columns, whitened))


def hidden_in(campaign: Campaign) -> list[Effect]:
    """List the hidden effects, and the true terms that the header's base model does not free.

    Those terms are parallel twists and joint compliances.
    """
    world, freed = campaign.world, campaign.header["model"]["fit"]
    effects = list(world.effects)
    lacking = {
        "parallel_twist": ("beta", [math.degrees(beta) for beta in world.geometry.beta]),
        "compliance": ("c", world.compliance),
    }
    for group, (amplitude, values) in lacking.items():
        if group not in freed:
            name = group if group == "parallel_twist" else f"joint_{group}"
            effects += [
                world.draw_effect(f"{name}:j{k}").with_values(**{amplitude: value})
                for k, value in enumerate(values, start=1)
                if value != 0.0
            ]
    return effects


def true_columns(world: World, effect: Effect, campaign: Campaign) -> Array:
    """Compute the displacement of noise-free readings by each amplitude alone, (n, 3, p), mm."""
    names = list(effect.amplitudes)
    alone = [effect.with_values(**{other: 0.0 for other in names if other != name}) for name in names]
    return np.stack([displacement(world, one, campaign.readings) for one in alone], axis=2)


def _whitened(base: IdentificationFit, columns: Array) -> Array:
    """Whiten columns for the readings of a fit, (k n, p)."""
    readings = base.readings
    return np.einsum("abn,nbp->anp", readings.observed.whiten, columns[readings.rows]).reshape(
        -1, columns.shape[2]
    )


def shown_beside(
    space: Space, library: list[Family], label: str, displaced: Array, others: list[Array]
) -> Shown:
    """Compute lambda and gap of one effect, given the true columns of the others."""
    basis = _wider(space.basis, others)
    held = np.zeros(len(basis))
    held[: space.size] = displaced
    held -= basis @ (basis.T @ held)
    size = float(held @ held)
    seen = replace(space, basis=basis, held=held, residual=held[: space.size].reshape(space.residual.shape))
    scores = Scores(library, seen)
    rival, best = "nothing", 0.0
    for index, family in enumerate(scores.families):
        gains, _ = scores.gains(index)
        allowed = _rivals(family, label)
        if allowed.any() and float(np.max(gains[allowed])) > best:
            place = int(np.argmax(np.where(allowed, gains, -1.0)))
            rival, best = family.effect(place).label, float(gains[place])
    return Shown(label, size, size - best, rival, best / max(size, 1e-300))


def _rivals(family: object, label: str) -> NDArray[np.bool_]:
    """Mask the places of a family that are rivals of the effect `label`."""
    if isinstance(family, HarmonicScores):
        orders = family.family.orders
        whole = np.abs(orders - np.round(orders)) < 1e-9
        if label.startswith(family.label + ":"):
            return whole & (np.abs(orders - float(label.rpartition(":n")[2])) > 0.5)
        return whole
    if isinstance(family, StepScores):  # a creep is never chosen: it is a rival of the step alone
        return family.rivals if family.label == label else ~family.rivals
    return np.full(len(family.raw), family.label != label)  # type: ignore[attr-defined]


def _wider(basis: Array, others: list[Array]) -> Array:
    """Extend the basis by the directions that the columns of the other effects add."""
    if not others:
        return basis
    columns = np.column_stack(others)
    padded = np.zeros((len(basis), columns.shape[1]))
    padded[: len(columns)] = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    for _ in range(2):
        padded = padded - basis @ (basis.T @ padded)
    u, s, _ = np.linalg.svd(padded, full_matrices=False)
    return np.column_stack([basis, u[:, s > 1e-3]])


def _ideal(data: Dataset, moved: Array, space: Space, columns: list[Array], whitened: list[Array]) -> float:
    """Return the RMS error of the linear fit of base model and true columns, mm.

    It is taken on validation rows. Without the effects, the readings are those of the quiet fit. A fit of the full
    readings finds the true amplitudes plus the part of the noise that the true columns absorb.
    """
    rows = data.validation_rows & data.pointed
    if not rows.any():
        return float("nan")
    base = space.fitted
    live = np.diag(base.covariance) > 0.0
    added = sum(w.shape[1] for w in whitened)
    stacked = np.zeros((len(space.held), live.sum() + added))
    stacked[: space.size, : live.sum()] = space.columns[:, live]
    stacked[space.size :, : live.sum()] = np.diag(base.prior[live])
    stacked[: space.size, live.sum() :] = np.column_stack([np.zeros((space.size, 0)), *whitened])
    scale = np.maximum(np.linalg.norm(stacked, axis=0), 1e-300)
    step = np.linalg.lstsq(stacked / scale, space.held, rcond=1e-12)[0] / scale
    design = BoundModel(base.model, data.conditions.take(rows))
    frames = design.frames(base.estimate, design.slots)
    n = int(rows.sum())
    predicted = frames.p.T + (design.point_columns(frames)[:, live] @ step[: live.sum()]).reshape(3, n).T
    beside = np.concatenate([np.zeros((n, 3, 0)), *(c[rows] for c in columns)], axis=2) @ step[live.sum() :]
    error = data.points[rows] - moved[rows] - predicted - beside
    return float(np.sqrt(np.mean(np.sum(error**2, axis=1))))
