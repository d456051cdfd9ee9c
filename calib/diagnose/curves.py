"""Curves of gears: all whole orders of a joint's transmission error, in one linear solve.

If many waves of a gear are above the noise, their names mean little, and other readings would lead to a different
choice. On a UR10, sixty waves and five curves found in one series depended on the range in which they were found.
Evidence sizes the prior of a curve by joint and half octave. The base model and the named effects are fitted together
with the curves, and their parameters stay free. A joint keeps its curve if left-out blocks of the campaign gain from
it. An order that is far larger than its neighbours is named as a separate wave. While named effects are searched for in
the remaining residual, the curves are fixed: a candidate then counts only for its additional explanation.

The columns are too many for memory. The fit is linearised and its prior is Gaussian, so J'J and J'y of each block of
the campaign are sufficient:

    x = (N + P)^-1 (g + P mean),    N = sum of J'J over the blocks, P = s^2 / size^2 on the diagonal.

Sizes are those of the largest marginal likelihood. With C = (N + P)^-1, the readings determine parameter i by the share
gamma_i = 1 - P_i C_ii, and the sizes are fixed points of

    size^2 = sum x_i^2 / sum gamma_i,    s^2 = |y - J x|^2 / (rows - sum gamma_i).

A fit without block B leaves the squared error |y_B|^2 - 2 x'g_B + x'N_B x there, with x from the other blocks.
Source: MacKay 1992.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import get_lapack_funcs
from scipy.special import fdtrc, stdtr

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.dataset import Dataset
from calib.effects import Survey, by_axis
from calib.effects.transmission import BANDS, HIGHEST, curve_of, gear_orders, half_octave, periodic
from calib.fit import robust
from calib.fit.held_out import all_readings
from calib.fit.identification import IdentificationFit
from calib.fit.identify import Progress, carry, leaving_out, silent
from calib.fit.least_squares import LEAST_NOISE, usual_sizes
from calib.fit.readings import FitReadings, linearised
from calib.model.effect import Effect
from calib.model.model import BoundModel, ModelStructure
from calib.scan.scores import CLAIM
from calib.units import DEG

BLOCKS = 8
_LEAST_SIZE, _LARGEST_SIZE = 1e-8, 1e-3  # rad: 0.0006 mdeg, and 57 mdeg, more than any gear errs
_LEAST_SHARE = 1e-3  # parameters that a band must determine for its size to be estimated


def blocks_of(conditions: Conditions) -> NDArray[np.int64]:
    """Assign each reading to a block, shape (n,).

    A block is a stretch of equal length of each series, in the order in which the poses were first visited. Poses stay
    whole, because a curve of many orders overfits the error of a single pose.
    """
    block = np.zeros(len(conditions), dtype=np.int64)
    for s in np.unique(conditions.series):
        rows = np.flatnonzero(conditions.series == s)
        order, pose = conditions.order[rows], conditions.pose[rows]
        first = np.full(int(pose.max()) + 1, np.inf)
        np.minimum.at(first, pose, order)
        stretch = np.argsort(np.lexsort((order, first[pose]))) * BLOCKS // len(rows)
        of_pose = np.full(len(first), BLOCKS)
        np.minimum.at(of_pose, pose, stretch)
        block[rows] = of_pose[pose]
    return block


@dataclass(frozen=True)
class Posterior:
    """Posterior of a linear fit.

    Attributes
    ----------
    estimate, variance, determined, mean : array of shape (a,)
        Estimate, prior variances, share that the readings determine, and prior means.
    covariance : array of shape (a, a)
        Covariance for unit noise.
    noise : float
        Variance of the noise.
    """

    estimate: Array
    covariance: Array
    noise: float
    variance: Array
    determined: Array
    mean: Array


@dataclass(frozen=True)
class NormalEquations:
    """Normal equations of a linear fit, by block.

    Attributes
    ----------
    gram : array of shape (B, a, a)
        J'J of each block.
    right : array of shape (B, a)
        J'y of each block; y is relative to an estimate of zero.
    square : array of shape (B,)
        |y|^2 of each block.
    rows : int
        Number of rows.
    """

    gram: Array
    right: Array
    square: Array
    rows: int

    @classmethod
    def of(
        cls, model: ModelStructure, readings: FitReadings, estimate: Array, active: NDArray[np.bool_]
    ) -> NormalEquations:
        """Compute the normal equations of a model linearised at an estimate (m,).

        Only the parameters in the mask `active` (m,) take part.
        """
        block, count = blocks_of(readings.conditions), int(active.sum())
        gram, right, square = np.zeros((BLOCKS, count, count)), np.zeros((BLOCKS, count)), np.zeros(BLOCKS)
        for b in range(BLOCKS):
            for _, residual, by_row in linearised(
                model, readings.taken(np.flatnonzero(block == b)), estimate
            ):
                columns = by_row.T[active]
                y = residual.ravel() + estimate[active] @ columns
                gram[b] += columns @ columns.T
                right[b] += columns @ y
                square[b] += y @ y
        return cls(gram, right, square, readings.observed.count)

    def take(self, columns: NDArray[np.int64]) -> NormalEquations:
        """Return the normal equations of some of the columns."""
        return replace(self, gram=self.gram[:, columns[:, None], columns], right=self.right[:, columns])

    def posterior(
        self,
        prior: Array,
        band: NDArray[np.int64],
        measured: NDArray[np.bool_],
        rounds: int,
        mean: Array | None = None,
    ) -> Posterior:
        """Compute the fit, its noise, and the sizes of its bands by evidence.

        Parameters
        ----------
        prior : array of shape (a,)
            Prior variances, infinite for free parameters; start values for the columns of a band.
        band : array of int, shape (a,)
            Band of each column; -1 outside the bands.
        measured : array of bool, shape (a,)
            Priors that are measurements; their weight is relative to at least the declared noise.
        mean : array of shape (a,), optional
            Means of the priors. Default: zero.
        """
        gram, right, square = self.gram.sum(axis=0), self.right.sum(axis=0), float(self.square.sum())
        variance, banded = prior.copy(), band >= 0
        mean = np.zeros(len(prior)) if mean is None else mean
        noise = 1.0
        while True:
            penalty = np.where(measured, max(noise, 1.0), noise) / variance
            covariance = inverse(gram, penalty)
            estimate = covariance @ (right + penalty * mean)
            determined = 1.0 - penalty * np.diag(covariance)
            left = square - 2.0 * float(estimate @ right) + float(estimate @ gram @ estimate)
            noise = max(left / max(self.rows - float(determined.sum()), 1.0), LEAST_NOISE**2)
            rounds -= 1
            if rounds <= 0:
                return Posterior(estimate, covariance, noise, variance, determined, mean)
            energy = np.bincount(band[banded], estimate[banded] ** 2)
            freedom = np.bincount(band[banded], determined[banded])
            size = np.sqrt(energy / np.maximum(freedom, _LEAST_SHARE))
            variance[banded] = np.clip(size, _LEAST_SIZE, _LARGEST_SIZE)[band[banded]] ** 2

    def left_out(self, posterior: Posterior, groups: list[NDArray[np.int64]]) -> Array:
        """Compute the gain (groups, B) of each group of columns on each left-out block.

        The gain is the decrease of the squared error of the block at the priors of `posterior`. It is negative if the
        group does harm to readings that it was not fitted to.
        """
        gram, right = self.gram.sum(axis=0), self.right.sum(axis=0)
        penalty = posterior.noise / posterior.variance
        gains = np.zeros((len(groups), BLOCKS))
        for b in range(BLOCKS):
            covariance = inverse(gram - self.gram[b], penalty)
            estimate = covariance @ (right - self.right[b] + penalty * posterior.mean)
            whole = self._error(b, estimate)
            gains[:, b] = [self._error(b, _without(estimate, covariance, group)) - whole for group in groups]
        return gains

    def _error(self, block: int, estimate: Array) -> float:
        moved = self.gram[block] @ estimate
        return float(self.square[block] - 2.0 * estimate @ self.right[block] + estimate @ moved)


def _without(estimate: Array, covariance: Array, columns: NDArray[np.int64]) -> Array:
    """Compute the estimate (a,) under the condition that some parameters are zero."""
    within = covariance[np.ix_(columns, columns)]
    out = estimate - covariance[:, columns] @ np.linalg.solve(within, estimate[columns])
    out[columns] = 0.0
    return out


def inverse(gram: Array, penalty: Array) -> Array:
    """Compute the inverse (a, a) of J'J + diag(penalty), scaled internally to a unit diagonal.

    Raises
    ------
    numpy.linalg.LinAlgError
        Readings and priors together leave a direction undetermined.
    """
    size = np.sqrt(np.diag(gram) + penalty)
    scaled = gram / np.outer(size, size)
    np.fill_diagonal(scaled, 1.0)
    factor, invert = get_lapack_funcs(("potrf", "potri"), (scaled,))
    lower, wrong = factor(scaled, lower=1)
    if wrong:
        raise np.linalg.LinAlgError("the normal equations are singular")
    half, _ = invert(lower, lower=1)
    whole: Array = half + half.T
    np.fill_diagonal(whole, np.diag(half))
    return whole / np.outer(size, size)


MANY_WAVES = 12  # waves found in a first search, from which on curves are tried
_NUMBERS = 2  # fewest measured numbers per amplitude of a curve
_ROUNDS, _AGAIN = 10, 4  # rounds of the evidence, from a first guess and from the sizes of an earlier fit
_CHANCE = 0.01  # probability that the blocks confirm a curve although no gear has an error
_LEAST_GAIN = 0.01  # least gain of left-out blocks, as a share of the squared residual
_NEIGHBOURS = 1.5  # ratio of orders that count as neighbours of one another
_FEWEST_NEIGHBOURS = 3
_FIRST_SIZE = 1e-4 / DEG

Sizes = Mapping[int, Array]  # joint -> (BANDS,) usual size of the amplitudes of every half octave, deg


@dataclass(frozen=True)
class GearCurveFit:
    """Fit with curves of gears, all other parameters free, and the usual sizes of the curves."""

    fitted: IdentificationFit
    curves: Mapping[int, Effect]  # by joint
    sizes: Sizes
    determined: Array  # (m,) how much of every parameter the readings determine, 0 to 1

    @property
    def held(self) -> IdentificationFit:
        """Fit with the curves fixed, as part of the nominal motion without parameters."""
        fitted, model = self.fitted, self.fitted.model
        others = tuple(e for e in model.effects if e not in self.curves.values())
        curves = tuple(
            curve_of(joint, curve, fitted.estimate[model.positions(curve)])
            for joint, curve in self.curves.items()
        )
        kept = [i for e in others for i in model.positions(e)]
        return replace(
            fitted,
            model=replace(model, effects=others, curves=curves),
            estimate=fitted.estimate[kept],
            covariance=fitted.covariance[np.ix_(kept, kept)],
            prior=fitted.prior[kept],
        )


def gears_to_carry(fitted: IdentificationFit, dataset: Dataset) -> list[int]:
    """List the joints for which these readings can determine curves.

    The list is empty if there are too few readings, or too few different poses: repeating a pose adds no information
    about a curve.
    """
    moving = Survey.of(fitted, dataset).moving
    pose = fitted.readings.conditions.pose
    numbers = fitted.readings.observed.count * (int(pose.max()) + 1) / len(pose)
    return moving if numbers >= _NUMBERS * 2 * HIGHEST * len(moving) else []


def with_gears(
    dataset: Dataset, named: IdentificationFit, joints: list[int], *, progress: Progress = silent
) -> GearCurveFit | None:
    """Add a curve for each of the joints that left-out blocks confirm to the effects of `named`.

    Orders that are far above their neighbours become named waves. Returns None if no joint is confirmed.
    """
    if not joints:
        return None
    progress(f"curves of whole orders for the gears of {len(joints)} joints")
    trial = _Trial.of(named, {k: np.full(BANDS, _FIRST_SIZE) for k in joints})
    posterior = trial.posterior(_ROUNDS)
    gains = trial.normal.left_out(posterior, [trial.columns(curve) for curve in trial.curves.values()])
    error = np.maximum(gains.std(axis=1, ddof=1) / np.sqrt(BLOCKS), 1e-300)
    chance = stdtr(BLOCKS - 1, -gains.mean(axis=1) / error) * len(joints)
    confirmed = (chance < _CHANCE) & (gains.sum(axis=1) > _LEAST_GAIN * np.sum(named.residual**2))
    if not confirmed.any():
        return None
    kept = [k for k, sure in zip(joints, confirmed, strict=True) if sure]
    trial, posterior = trial.keeping(kept, posterior)
    first = trial.carried(posterior)
    first = replace(first, fitted=_belonging(dataset, first.fitted))
    second = beside(first.held, first.sizes)
    names = _outstanding(second)
    return beside(_naming(second.held, names), second.sizes) if names else second


def beside(named: IdentificationFit, sizes: Sizes) -> GearCurveFit:
    """Fit everything of `named` together with a curve for each joint of `sizes`."""
    trial = _Trial.of(named, sizes)
    return trial.carried(trial.posterior(_AGAIN))


@dataclass(frozen=True)
class _Trial:
    """Curves and all other effects, linearised at the current fit.

    `active` has shape (m,); the attributes after it have shape (a,) over the active parameters.
    """

    named: IdentificationFit
    model: ModelStructure
    curves: Mapping[int, Effect]
    start: Array
    active: NDArray[np.bool_]
    band: NDArray[np.int64]  # of every column; -1 outside the curves
    normal: NormalEquations

    @classmethod
    def of(cls, named: IdentificationFit, sizes: Sizes) -> _Trial:
        """Build the curves of some joints with given sizes."""
        orders = _named_orders(named.model.effects)
        robot = named.model.robot
        curves = {
            k: by_axis(gear_orders(k, of_joint, orders.get(k, ())), robot) for k, of_joint in sizes.items()
        }
        model = replace(named.model.append(*curves.values()), curves=())
        start = carry(named.model, named.estimate, model)
        active = np.ones(len(start), dtype=bool)
        active[: len(named.estimate)] = np.diag(named.covariance) > 0.0
        band = np.full(len(start), -1)
        for i, curve in enumerate(curves.values()):
            band[model.positions(curve)] = [
                i * BANDS + half_octave(int(p.short[3:])) for p in curve.parameters
            ]
        return cls(
            named,
            model,
            curves,
            start,
            active,
            band[active],
            NormalEquations.of(model, named.readings, start, active),
        )

    def columns(self, curve: Effect) -> NDArray[np.int64]:
        """Return the indices of a curve's parameters among the active ones."""
        place = np.cumsum(self.active) - 1
        return place[self.model.positions(curve)]

    def keeping(self, joints: list[int], posterior: Posterior) -> tuple[_Trial, Posterior]:
        """Keep the curves of some joints, from the same normal equations and sizes."""
        curves = {k: self.curves[k] for k in joints}
        gone = [curve for k, curve in self.curves.items() if k not in joints]
        stay = np.ones(len(self.start), dtype=bool)
        stay[[i for curve in gone for i in self.model.positions(curve)]] = False
        columns = np.flatnonzero(stay[self.active])
        band = self.band[columns]
        number = np.unique(band // BANDS, return_inverse=True)[1].reshape(-1) - 1
        model, active = self.model.without(*(curve.label for curve in gone)), self.active[stay]
        band = np.where(band < 0, band, number * BANDS + band % BANDS)
        normal = self.normal.take(columns)
        found = normal.posterior(
            posterior.variance[columns], band, model.measured[active], _AGAIN, model.prior_mean[active]
        )
        return _Trial(self.named, model, curves, self.start[stay], active, band, normal), found

    def posterior(self, rounds: int) -> Posterior:
        """Compute the fit, with sizes by evidence."""
        model, active = self.model, self.active
        usual = usual_sizes(model, self.named.dropped)
        measured, mean = model.measured[active], model.prior_mean[active]
        return self.normal.posterior(usual[active] ** 2, self.band, measured, rounds, mean)

    def carried(self, posterior: Posterior) -> GearCurveFit:
        """Build the full fit, with its residual from the exact chain."""
        named, active = self.named, self.active
        sizes = {k: np.full(BANDS, _FIRST_SIZE) for k in self.curves}
        for i, of_joint in enumerate(sizes.values()):
            mine = self.band // BANDS == i
            of_joint[self.band[mine] % BANDS] = np.sqrt(posterior.variance[mine]) / DEG
        orders = _named_orders(named.model.effects)
        robot = named.model.robot
        curves = {
            k: by_axis(gear_orders(k, of_joint, orders.get(k, ())), robot) for k, of_joint in sizes.items()
        }
        model = replace(named.model.append(*curves.values()), curves=())
        count = len(self.start)
        estimate, determined, prior = self.start.copy(), np.zeros(count), np.zeros(count)
        estimate[active], determined[active] = posterior.estimate, posterior.determined
        prior[active] = np.sqrt(posterior.noise / posterior.variance)
        readings = named.readings
        residual = readings.observed.residual(BoundModel(model, readings.conditions).frames(estimate, ()))
        freedom = readings.observed.count - round(float(determined.sum()))
        scale = float(np.sqrt(np.sum(residual**2) / max(freedom, 1)))
        covariance = np.zeros((count, count))
        covariance[np.ix_(active, active)] = posterior.covariance * max(scale, 1.0) ** 2
        fitted = replace(
            named,
            model=model,
            estimate=estimate,
            covariance=covariance,
            prior=prior,
            residual=residual,
            noise_scale=scale,
            degrees_of_freedom=freedom,
        )
        return GearCurveFit(fitted, curves, sizes, determined)


def _named_orders(effects: tuple[Effect, ...]) -> dict[int, set[int]]:
    """Map each joint to the whole orders that are named as separate waves.

    These are no part of the joint's curve.
    """
    named: dict[int, set[int]] = {}
    for effect in effects:
        if effect.wave is None:
            continue
        joint, slots = effect.wave
        if slots == {f"theta{joint}"} and float(effect.shape["order"]).is_integer():
            named.setdefault(joint, set()).add(round(effect.shape["order"]))
    return named


def _belonging(dataset: Dataset, fitted: IdentificationFit) -> IdentificationFit:
    """Select again the readings that the fit can explain.

    Some readings that only curves explain had been rejected. Others had been hidden by the errors of the gears.
    """
    readings, _ = all_readings(dataset, fitted)
    residual = readings.observed.alone.residual(
        BoundModel(fitted.model, readings.conditions).frames(fitted.estimate, ())
    )
    faulty = robust.outliers(residual, readings.observed.freedom)
    rejected = tuple(dataset.reading_id[i] for i in readings.rows[faulty])
    return leaving_out(fitted, readings.take(~faulty), rejected)


def _naming(fitted: IdentificationFit, orders: list[tuple[int, int]]) -> IdentificationFit:
    """Add waves of some orders (joint, order) to the model of a fit, from zero."""
    waves = tuple(periodic(joint, float(order)) for joint, order in orders)
    model = fitted.model.append(*waves)
    count, more = len(fitted.estimate), 2 * len(waves)
    covariance = np.eye(count + more)
    covariance[:count, :count] = fitted.covariance
    return replace(
        fitted,
        model=model,
        estimate=np.concatenate([fitted.estimate, np.zeros(more)]),
        covariance=covariance,
        prior=np.concatenate([fitted.prior, np.zeros(more)]),
    )


def _outstanding(carried: GearCurveFit) -> list[tuple[int, int]]:
    """List joint and order of every wave far above its neighbours, largest first.

    The readings alone determine an order as y with covariance V: its estimate with its own prior removed.
    With m neighbours of mean square s^2 the test is y'(V + s^2 I)^-1 y / 2 against F(2, 2m), corrected for all orders.
    """
    found = []
    for joint, curve in carried.curves.items():
        positions = carried.fitted.model.positions(curve)
        orders = np.array([int(p.short[3:]) for p in curve.parameters[::2]])
        x = carried.fitted.estimate[positions].reshape(-1, 2)
        own = carried.fitted.covariance[np.ix_(positions, positions)]
        spread = np.stack([own[i : i + 2, i : i + 2] for i in range(0, len(own), 2)])
        energy = np.sum(x**2, axis=1) + np.trace(spread, axis1=1, axis2=2)
        held = (carried.fitted.prior[positions[::2]] / max(carried.fitted.noise_scale, 1.0)) ** 2
        apart = np.linalg.inv(np.eye(2) - spread * held[:, None, None])
        y, alone = np.einsum("nij,nj->ni", apart, x), apart @ spread
        named = np.zeros(len(orders), dtype=bool)
        for i in np.argsort(-energy):
            near = np.abs(np.log(orders / orders[i])) <= np.log(_NEIGHBOURS)
            near[i] = False
            near &= ~named
            count = int(near.sum())
            if count < _FEWEST_NEIGHBOURS:
                continue
            like = alone[i] + 0.5 * np.mean(energy[near]) * np.eye(2)
            ratio = 0.5 * float(y[i] @ np.linalg.solve(like, y[i]))
            chance = float(fdtrc(2, 2 * count, ratio)) * len(orders) * len(carried.curves)
            if chance < CLAIM:
                named[i] = True
                found.append((joint, int(orders[i])))
    return found
