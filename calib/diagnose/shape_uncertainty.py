"""The uncertainty of what was scanned: time constants, orders and moments of change.

A scan fixes a shape constant s, and the covariance of the amplitudes holds for that value only. With the derivative
d = (dX/ds) b of the readings by the constant as one more column of the Jacobian J,

    var(s) = v / |P d|^2,    cov(b) += g var(s) g',    g = -(J'J)^-1 J'd,

v the variance of the noise and P what the model leaves. A moment of change has no derivative. Its interval holds the
change points with 95 % of the posterior probability, all of them being equally likely beforehand. Rows held out
between two readings of the fit show nothing of the moment, so the interval ends at readings of the fit.
Whole orders of a wave are exact: a wheel turns a whole number of times.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from calib.array import Array
from calib.data.dataset import Dataset
from calib.diagnose.named import Found
from calib.effects import Survey, offers
from calib.fit.identification import Identification
from calib.model.effect import Effect
from calib.scan.harmonics import Harmonics
from calib.scan.scores import Family, Scores
from calib.scan.shapes import Shapes
from calib.scan.space import Space
from calib.scan.steps import Steps

_NUDGE = 1e-3  # relative change of a constant for its derivative
_COVERED = 0.95


def with_shapes(dataset: Dataset, fitted: Identification, found: Sequence[Found]) -> list[Found]:
    """The findings with the uncertainty of their shapes, and with amplitudes that are as uncertain as these make them.

    fitted: the fit whose model holds the effects.
    """
    if not any(each.effect.shape and not each.effect.is_curve for each in found):
        return list(found)
    space = Space.of(fitted)
    offered = offers(Survey.of(fitted, dataset))
    families = [next((f for f in offered if f.made(each.effect)), None) for each in found]
    found = [
        replace(each, between=_between(dataset, space, family, each.effect))
        if isinstance(family, Steps)
        else each
        for each, family in zip(found, families, strict=True)
    ]
    shaped = [
        (i, name, derivative)
        for i, (each, family) in enumerate(zip(found, families, strict=True))
        for name, derivative in _derivative(space, family, each.effect)
    ]
    if not shaped:
        return found
    columns = np.column_stack([derivative for _, _, derivative in shaped])
    left = columns - space.basis_of_readings @ (space.basis_of_readings.T @ columns)
    noise = max(fitted.noise_scale, 1.0) ** 2
    shapes = noise * np.linalg.pinv(left.T @ left, hermitian=True)
    carried = -space.covariance @ (space.columns.T @ columns)
    spread = np.sqrt(np.diag(shapes))
    for j, (i, name, _) in enumerate(shaped):
        at = fitted.model.positions(found[i].effect)
        found[i] = replace(
            found[i],
            covariance=found[i].covariance + carried[at] @ shapes @ carried[at].T,
            shape_std={name: float(spread[j])},
        )
    return found


def _derivative(space: Space, family: Family | None, effect: Effect) -> list[tuple[str, Array]]:
    """The name of an effect's constant and the derivative (size,) of the readings by it; empty without a constant that
    readings determine."""
    if isinstance(family, Shapes):
        name = family.key
    elif isinstance(family, Harmonics) and not effect.shape["order"].is_integer():
        name = "order"
    else:
        return []
    step = _NUDGE * effect.shape[name]
    more, less = (space.effect_columns(family.at(effect.shape[name] + h)) for h in (step, -step))
    values = space.fitted.estimate[space.fitted.model.positions(effect)]
    return [(name, (more - less) @ values / (2.0 * step))]


def _between(dataset: Dataset, space: Space, family: Steps, effect: Effect) -> tuple[str, str] | None:
    """The ids of the last reading before a step and of the first after it, with a probability of 95 %."""
    order = space.fitted.readings.conditions.order
    scores = Scores([replace(family, scanned=len(family.every))], space)
    scores.move(*space.own_direction(effect), enters=False)
    gain = scores.gains(0)[0][: len(family.every)]
    noise = max(space.rss / max(space.freedom, 1), 1e-300)
    weight = np.exp(0.5 * (gain - gain.max()) / noise)
    likely = np.argsort(-weight)
    kept = likely[: int(np.searchsorted(np.cumsum(weight[likely]) / weight.sum(), _COVERED)) + 1]
    ranks = [*family.every[kept].tolist(), effect.shape["rank"]]
    before = order[order < min(ranks)]
    if not len(before) or not math.isfinite(max(ranks)):
        return None
    ids = [
        dataset.reading_id[int(np.flatnonzero(dataset.conditions.order == rank)[0])]
        for rank in (before.max(), max(ranks))
    ]
    return str(ids[0]), str(ids[1])
