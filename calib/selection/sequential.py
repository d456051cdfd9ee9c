"""Sequential selection: the poses to measure next, and the accuracy that the readings so far promise.

A campaign that chooses its poses while it measures needs two numbers after every batch: how accurate the model is
everywhere in the working zone, and how much more accurate the next poses would make it.

**Accuracy.** Every visit is predicted before its readings enter a fit. Its miss is z2 = e' S^-1 e, where e is measured
minus predicted, and S what noise and the uncertainty of the parameters lead one to expect there; z2 has as many
degrees of freedom as e has numbers. The RMS error of a reading anywhere in the zone is the one expected there, times
sqrt(sum z2 / sum dof), at least 1; the upper limit follows from the chi-square distribution. Each miss is measured
in units of what was expected of its pose. So poses that were chosen for the fit take part without bias, and no readings
need to be kept aside.

**Repeated looks.** A limit that holds in 95 % of looks is below the truth at some look far more often: in 21 % of
campaigns with 16 looks if all misses count, and in 43 % if those of the last 15 visits do. A limit of `DECIDING` in
each look is so in 5.5 % of campaigns with 16 looks, and in 7 % with 28 (chi-square misses of five visits a look, 20,000
draws; Pocock 1977 has such constants for normal ones).

**Next poses.** The V-optimal choice: the pose that lowers the mean variance of predictions over the zone the most, per
second that it costs. With C the covariance of the parameters, A = mean of X'X over the zone, X the derivative of a
target, and B the whitened rows of a pose, a pose lowers tr(A C) by tr[(I + B C B')^-1 B C A C B'].

**Lengths.** A ballbar measures distances to balls on the base, whose place in the world is unknown. The
error of a position is then that relative to the balls: the rigid motion that carries their places as identified to
their true ones is no part of it. Legs lie in a part of the zone, and their misses do not show how wrong this model is
elsewhere. Its mean square error there is e' A e, where e has covariance C, and its mean is tr(A C). One model may
exceed that mean. By Satterthwaite the error is distributed as tr(A C) chi2 / nu, nu = tr(A C)^2 / tr(A C A C); a limit
takes the quantile at its level.
Source of the criterion: Klimchik et al. 2012 (arXiv 1211.5739), as the test-pose criterion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import chdtri

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.data.noise import Noise
from calib.fit.identification import IdentificationFit, predict_with_covariance
from calib.fit.readings import linearised, readings_of
from calib.model.model import BoundModel, ModelStructure
from calib.selection.information import derivatives, whitened
from calib.selection.lengths import rows_of_lengths
from calib.units import DEG

_FREE = {"mm": 10.0, "deg": 1.0 * DEG}  # usual size of a parameter that has no prior, internal units
LEVEL = 0.95
"""Confidence of the limit of the accuracy, in each look."""
DECIDING = 0.99
"""Confidence in each look of the limit that ends a campaign, for about `LEVEL` in all its looks together."""


@dataclass(frozen=True)
class Misses:
    """By how much v visits missed what had been predicted for them.

    Attributes
    ----------
    reading : tuple of str
        Id of the first reading of each visit.
    square : array of shape (v,)
        Squared standardised distance z2.
    numbers : array of int, shape (v,)
        Numbers that were measured in each visit: the degrees of freedom of its z2.
    """

    reading: tuple[str, ...]
    square: Array
    numbers: NDArray[np.int64]


def misses(found: IdentificationFit, dataset: Dataset, rows: NDArray[np.bool_]) -> Misses:
    """Compare the readings of a mask (n,), which took no part in a fit, with what the fit predicts for them.

    They are measured in units of the declared noise, whatever noise the fit found: its estimate scatters, and the
    misses tell it better.
    """
    readings = readings_of(dataset, rows, found.model, found.estimate)
    covariance = declared_covariance(found)
    first: list[int] = []
    square: list[float] = []
    numbers: list[int] = []
    for part, residual, columns in linearised(found.model, readings, found.estimate):
        k, n = residual.shape
        by_reading = columns.reshape(k, n, -1).transpose(1, 0, 2)
        _, begin, of_reading, size = np.unique(
            readings.conditions.visit[part], return_index=True, return_inverse=True, return_counts=True
        )
        in_order = np.argsort(of_reading, kind="stable")
        start = np.concatenate([[0], np.cumsum(size)[:-1]])
        for count in np.unique(size).tolist():  # visits of as many readings, together
            same = np.flatnonzero(size == count)
            which = in_order[start[same][:, None] + np.arange(count)]  # (visits, count)
            left = residual.T[which].reshape(len(same), -1)
            x = by_reading[which].reshape(len(same), count * k, -1)
            spread = np.eye(count * k) + x @ covariance @ x.transpose(0, 2, 1)
            solved = np.linalg.solve(spread, left[:, :, None])[:, :, 0]
            square += np.sum(left * solved, axis=1).tolist()
            first += readings.rows[part[begin[same]]].tolist()
            numbers += readings.observed.freedom[part[which]].sum(axis=1).tolist()
    order = np.argsort(first)
    return Misses(
        tuple(dataset.reading_id[first[i]] for i in order),
        np.array(square)[order],
        np.array(numbers, dtype=np.int64)[order],
    )


def declared_covariance(found: IdentificationFit) -> Array:
    """Return the covariance (m, m) of the parameters of a fit, for noise as declared."""
    return found.covariance / max(found.noise_scale, 1.0) ** 2


def bound(
    expected_mm: float, square: Array, numbers: NDArray[np.int64], level: float = LEVEL
) -> tuple[float, float]:
    """Estimate the RMS error over a zone, and its upper limit, mm.

    Parameters
    ----------
    expected_mm
        RMS error that model and noise lead one to expect over the zone, mm.
    square, numbers : arrays of shape (v,)
        Misses of visits that were predicted before they were used, as in `Misses`.
    level
        Confidence of the limit.
    """
    seen, freedom = float(np.sum(square)), int(np.sum(numbers))
    usual = max(seen / freedom, 1.0)
    most = max(seen / float(chdtri(freedom, level)), 1.0)
    return expected_mm * float(np.sqrt(usual)), expected_mm * float(np.sqrt(most))


def least_bound(expected_mm: float, numbers: int, level: float = LEVEL) -> float:
    """Return the limit of `bound`, mm, for misses exactly as expected."""
    return expected_mm * float(np.sqrt(max(numbers / float(chdtri(numbers, level)), 1.0)))


def model_limit(spread: Array, covariance: Array, level: float) -> float:
    """Return the upper limit of the mean square error of one model over a zone, mm2, from its covariance alone."""
    product = spread @ covariance
    mean = float(np.trace(product))
    freedom = mean**2 / float(np.sum(product * product.T))
    return mean * float(chdtri(freedom, 1.0 - level)) / freedom


@dataclass(frozen=True)
class WorkingZone:
    """The poses over which a model is to be accurate, as the model sees them.

    Attributes
    ----------
    spread : array of shape (m, m)
        Mean of X'X over its readings, mm2 per squared internal unit; relative to the balls on the base, if any.
    floor_mm : float
        RMS of noise and repeatability in one reading as declared, mm: no model is more accurate.
    """

    spread: Array
    floor_mm: float


def zone_of(model: ModelStructure, estimate: Array, conditions: Conditions, noise: Noise) -> WorkingZone:
    """Describe a zone by n readings in it."""
    columns, scatter, instrument = derivatives(model, estimate, conditions, noise)
    if model.anchors:
        columns = columns - _of_frame(model, estimate, conditions)
    square = np.sum(scatter**2, axis=(1, 2)) + np.trace(instrument, axis1=1, axis2=2)
    spread = np.einsum("nam,nak->mk", columns, columns, optimize=True) / len(conditions)
    return WorkingZone(spread, float(np.sqrt(square.mean())))


def _of_frame(model: ModelStructure, estimate: Array, conditions: Conditions) -> Array:
    """Return the part (n, 3, m) of the derivatives of n points that is a motion of the balls on the base."""
    balls, moves = np.array(list(model.anchors.values())), np.zeros((len(model.anchors), 3, len(estimate)))
    for i, name in enumerate(model.anchors):
        for k, axis in enumerate("xyz"):
            position = model.index.get(f"{name}.{axis}")
            if position is not None:
                balls[i, k] += estimate[position]
                moves[i, k, position] = 1.0
    motion = np.linalg.pinv(_rigid(balls).reshape(-1, 6)) @ moves.reshape(-1, len(estimate))
    return _rigid(BoundModel(model, conditions).predict(estimate)) @ motion


def _rigid(points: Array) -> Array:
    """Return the displacements (n, 3, 6) of points by a unit of each shift and turn."""
    turns = np.cross(np.eye(3), points[:, None]).transpose(0, 2, 1)
    return np.concatenate([np.broadcast_to(np.eye(3), (len(points), 3, 3)), turns], axis=2)


def expected_rms(found: IdentificationFit, zone: WorkingZone, conditions: Conditions) -> float:
    """Return the RMS error of a reading in a zone that model and declared noise lead one to expect, mm.

    `conditions` are those of its n readings.
    """
    covariance = declared_covariance(found)
    _, beyond = predict_with_covariance(found.model, found.estimate, 0.0 * covariance, conditions)
    square = float(np.sum(zone.spread * covariance) + np.trace(beyond, axis1=1, axis2=2).mean())
    return float(np.hypot(np.sqrt(square), zone.floor_mm))


def usual_covariance(model: ModelStructure) -> Array:
    """Return the covariance (m, m) of the parameters before any reading, from their usual sizes."""
    free = np.array([_FREE.get(p.unit, 1.0) for p in model.parameters])
    return np.diag(np.where(np.isfinite(model.prior_std), model.prior_std, free) ** 2)


def rows_of_visits(
    model: ModelStructure, estimate: Array, conditions: Conditions, noise: Noise, targets: int
) -> Array:
    """Return the whitened rows (p, r, m) of p visits of so many readings, which follow each other in the conditions.

    A point has three rows, a distance one.
    """
    if conditions.anchor_names:
        lengths = rows_of_lengths(model, estimate, conditions, noise)
        return lengths.reshape(-1, targets, lengths.shape[1])
    parts = derivatives(model, estimate, conditions, noise)
    columns, scatter, instrument = (
        each.reshape(len(conditions) // targets, targets, *each.shape[1:]) for each in parts
    )
    return whitened(columns, scatter, instrument)


@dataclass(frozen=True)
class Design:
    """What is known of the parameters, and what p candidate poses would add.

    Attributes
    ----------
    rows : array of shape (p, r, m)
        Whitened rows of the candidates.
    spread : array of shape (m, m)
        That of the zone.
    covariance : array of shape (m, m)
        Covariance of the parameters for noise as declared.
    """

    rows: Array
    spread: Array
    covariance: Array

    @property
    def variance(self) -> float:
        """Mean square error over the zone from the parameters' uncertainty, mm2, for noise as declared."""
        return float(np.sum(self.spread * self.covariance))

    @property
    def gains(self) -> Array:
        """By how much each candidate would lower the variance, shape (p,), mm2."""
        seen = self.rows @ self.covariance
        inner = np.eye(seen.shape[1]) + seen @ self.rows.transpose(0, 2, 1)
        gain = seen @ self.spread @ seen.transpose(0, 2, 1)
        return np.trace(np.linalg.solve(inner, gain), axis1=1, axis2=2)

    def with_pose(self, i: int) -> Design:
        """Return the design once candidate i is measured."""
        seen = self.rows[i] @ self.covariance
        inner = np.eye(len(seen)) + seen @ self.rows[i].T
        return replace(self, covariance=self.covariance - seen.T @ np.linalg.solve(inner, seen))

    def best(self, count: int, taken: Sequence[int] = ()) -> tuple[list[int], Design]:
        """Choose `count` candidates that are not taken, one after the other, whatever time they cost."""
        chosen: list[int] = []
        design = self
        for _ in range(min(count, len(self.rows) - len(taken))):
            gains = design.gains
            gains[[*taken, *chosen]] = -np.inf
            chosen.append(int(np.argmax(gains)))
            design = design.with_pose(chosen[-1])
        return chosen, design
