"""Families of candidates: one effect, harmonics, steps, and effects of one shape constant.

Harmonics of a joint are scanned over all orders at once by a Fourier transform, then refined to orders
between them. The derivative of A cos(H theta) + B sin(H theta) by H is theta (B cos - A sin). One
Gauss-Newton step for all orders at once moves them, projected on the residuals of the model. An order
becomes whole if its nearest whole number lies within the uncertainty of the readings.

Steps at a reading are scanned at evenly spread change points by one cumulative sum, then refined to the
reading. Creeps between two readings that are far apart are scanned too. They are never chosen, but are
rivals of the best step if they fit nearly as well, since the readings then do not show that it happened
at once.

Effects of one shape constant, such as a time constant, are scanned at a few places and refined between
them. A Gauss-Newton step in the logarithm of the constant moves it, to whole units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.sparse import csr_array

from calib.array import Array
from calib.model.effect import Effect
from calib.scan.scores import WHOLE_ORDER, Family, FamilyScores, Scores, Space, bounds_of


class _Scan:
    """A family whose effects all have its own label."""

    def made(self: Family, effect: Effect) -> bool:
        """Test whether an effect is one of this family."""
        return effect.label == self.label


class ColumnScores:
    """Scores of one effect, or of one at several values of a constant.

    They use the columns of every place.
    """

    twins = True

    def __init__(self, family: Candidate | Shapes, effects: Sequence[Effect], space: Space) -> None:
        self.label = family.label
        self.family = family
        self.effects = effects
        self.columns = np.stack([space.effect_columns(effect).T for effect in effects])
        self.raw = np.sum(self.columns**2, axis=2)
        self.bounds = bounds_of(effects[0])
        self.rivals = np.zeros(len(effects), dtype=bool)

    def shared(self, space: Space, vectors: Array) -> Array:
        """Compute X'v, shape (places, p, c)."""
        return self.columns @ vectors

    def gram(self, space: Space) -> Array:
        """Compute X'X, shape (places, p, p)."""
        return self.columns @ self.columns.transpose(0, 2, 1)

    def choose(self, gain: Array, scores: Scores) -> int:
        """Choose the best place."""
        return int(np.argmax(gain))

    def alike(self, place: int) -> int:
        """Count all places, since any is as likely as any other."""
        return len(self.effects)

    def place_of(self, effect: Effect) -> int:
        """Find the place nearest to the constant of an effect of this family."""
        if isinstance(self.family, Candidate):
            return 0
        return int(np.argmin(np.abs(self.family.values - effect.shape[self.family.key])))

    def effect(self, place: int) -> Effect:
        """Return the effect at a place of the scan."""
        return self.effects[place]


@dataclass(frozen=True)
class Candidate(_Scan):
    """An effect that the diagnosis may propose as it is: nothing about it is scanned."""

    effect: Effect

    @property
    def label(self) -> str:
        """Label of the effect."""
        return self.effect.label

    def scores(self, space: Space) -> FamilyScores:
        """Score the effect in a space."""
        return ColumnScores(self, [self.effect], space)

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Candidate, Effect]]) -> list[Effect]:
        """Return the effects unchanged: nothing of them was scanned."""
        return [effect for _, effect in own]


_LONGEST_RATIO = 0.25  # by how much, in its logarithm, a shape constant may move at once


@dataclass(frozen=True)
class Shapes(_Scan):
    """A family of candidates of one shape constant, scanned over a few `values`.

    `key` is the constant in their `shape`. It is refined between `limits`, to whole units of it.
    """

    label: str
    key: str
    values: Array
    at: Callable[[float], Effect]
    limits: tuple[float, float]

    def scores(self, space: Space) -> FamilyScores:
        """Score the family in a space."""
        return ColumnScores(self, [self.at(float(value)) for value in self.values], space)

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Shapes, Effect]]) -> list[Effect]:
        """Improve the constants of effects, in whole units."""
        return [family._better(space, effect) for family, effect in own]

    def _better(self, space: Space, effect: Effect) -> Effect:
        """Improve an effect by a Gauss-Newton step of the logarithm of its constant.

        The derivative is by differences, since the columns are cheap.
        """
        constant = effect.shape[self.key]
        nudge = 1e-3
        longer, shorter = (space.effect_columns(self.at(constant * math.exp(h))) for h in (nudge, -nudge))
        values = space.fitted.estimate[space.fitted.model.positions(effect)]
        derivative = (longer - shorter) @ values / (2.0 * nudge)
        derivative = derivative - space.basis_of_readings @ (space.basis_of_readings.T @ derivative)
        size = max(float(derivative @ derivative), 1e-300)
        step = float(np.clip(derivative @ space.residual.ravel() / size, -_LONGEST_RATIO, _LONGEST_RATIO))
        better = float(np.clip(constant * math.exp(step), *self.limits))
        return self.at(float(round(better)))


# Sums of u exp(i H theta) over scattered angles, for many evenly spaced orders H at once.
#
# A Fourier transform of unevenly spaced samples: every sample is spread over its neighbours on a fine grid by a
# narrow Gaussian, the grid is transformed, and the Gaussian is divided out. The work grows with the readings and
# with the orders, not with their product. Source: Greengard and Lee, SIAM Review 46 (2004), section 3.


_HALF_WIDTH = 10  # grid points to either side: relative error near 1e-10
_OVERSAMPLING = 2


class TrigSums:
    """Sums for `orders` (evenly spaced, J of them) over the angles `theta` (n,), rad."""

    def __init__(self, theta: Array, orders: Array) -> None:
        self.count = len(orders)
        spacing = float(orders[1] - orders[0]) if self.count > 1 else 1.0
        modes = max(self.count, 4 * _HALF_WIDTH)
        self.grid = int(scipy.fft.next_fast_len(_OVERSAMPLING * modes, real=False) or 0)
        ratio = self.grid / modes
        width = np.pi * _HALF_WIDTH / (modes**2 * ratio * (ratio - 0.5))
        middle = self.count // 2
        # The mean order is taken out beforehand, so that the transform runs from -J/2 to J/2.
        self.carrier = np.exp(1j * theta * orders[middle])[:, None]
        angle = np.mod(spacing * theta, 2.0 * np.pi)
        step = 2.0 * np.pi / self.grid
        nearest = np.floor(angle / step).astype(np.int64)
        offsets = np.arange(-_HALF_WIDTH + 1, _HALF_WIDTH + 1)
        points = nearest[:, None] + offsets
        weights = np.exp(-((points * step - angle[:, None]) ** 2) / (4.0 * width))
        sample = np.broadcast_to(np.arange(len(theta))[:, None], points.shape)
        self.spread = csr_array(
            (weights.ravel(), (np.mod(points, self.grid).ravel(), sample.ravel())),
            shape=(self.grid, len(theta)),
        )
        mode = np.arange(self.count) - middle
        self.places = np.mod(mode, self.grid)
        self.undo = (np.sqrt(np.pi / width) * np.exp(mode**2 * width))[:, None]

    def of(self, values: Array) -> NDArray[np.complex128]:
        """Compute the complex sums of values (n, c) x exp(i order theta), shape (J, c)."""
        grid = self.spread @ (values * self.carrier)
        return scipy.fft.ifft(grid, axis=0)[self.places] * self.undo


_LOW_ORDER = 6
_LONGEST_STEP = 0.3  # cycles a turn
_RESOLUTION = 0.6  # cycles over the measured range within which two orders of a joint are one effect


@dataclass(frozen=True)
class Harmonics:
    """A family of candidates: cos and sin of order x theta of one joint on some slots.

    It is scanned over `orders`; an order may be refined down to `lowest`. Labels of its effects begin
    with its own and a colon.
    """

    label: str
    joint: int
    slots: tuple[tuple[str, float], ...]
    orders: Array
    at: Callable[[float], Effect]
    lowest: float

    @property
    def whole(self) -> bool:
        """Whether only whole orders are accepted."""
        return bool(np.all(self.orders == np.round(self.orders)))

    def scores(self, space: Space) -> FamilyScores:
        """Score the family in a space."""
        return HarmonicScores(self, space)

    def made(self, effect: Effect) -> bool:
        """Test whether an effect is one of this family."""
        return effect.label.startswith(f"{self.label}:")

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Harmonics, Effect]]) -> list[Effect]:
        """Improve the orders of effects, by one step for all of them."""
        columns = np.column_stack([family._by_order(space, effect) for family, effect in own])
        columns = columns - space.basis_of_readings @ (space.basis_of_readings.T @ columns)
        size = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
        step, *_ = np.linalg.lstsq(columns / size, space.residual.ravel(), rcond=1e-6)
        step = step / size
        noise = space.rss / max(space.freedom, 1)
        refined = []
        for (family, effect), change, norm in zip(own, step, size, strict=True):
            order = effect.shape["order"] + float(np.clip(change, -_LONGEST_STEP, _LONGEST_STEP))
            whole = max(1, round(order))
            lost = (order - whole) ** 2 * norm**2 / noise
            order = round(order, 2) if not family.whole and lost > WHOLE_ORDER else float(whole)
            refined.append(family.at(order) if order >= family.lowest else effect)
        return refined

    def _by_order(self, space: Space, effect: Effect) -> Array:
        """Differentiate the readings by the order of an effect, shape (size,)."""
        order = effect.shape["order"]
        theta = space.fitted.readings.conditions.joints[:, self.joint - 1]
        a, b = space.fitted.estimate[space.fitted.model.positions(effect)]
        drive = theta * (b * np.cos(order * theta) - a * np.sin(order * theta))
        return np.sum([weight * (space.slot(slot) * drive).ravel() for slot, weight in self.slots], axis=0)


def one_order(space: Space, one: Effect, other: Effect) -> bool:
    """Test whether two harmonics differ by less than the measured range resolves.

    They must be of one joint and act on the same slots.
    """
    if one.wave is None or one.wave != other.wave:
        return False
    turns = np.ptp(space.fitted.readings.conditions.joints[:, one.wave[0] - 1]) / (2.0 * np.pi)
    return bool(abs(one.shape["order"] - other.shape["order"]) * turns < _RESOLUTION)


class HarmonicScores:
    """Scores of a family of harmonics over its orders."""

    bounds = None
    twins = False  # every one has two columns, and its fit says it

    def __init__(self, family: Harmonics, space: Space) -> None:
        self.label = family.label
        self.family = family
        self.theta = space.fitted.readings.conditions.joints[:, family.joint - 1]
        self.slot_columns = sum(
            (weight * space.slot(slot) for slot, weight in family.slots), np.zeros((1, 1))
        )
        self.size = np.sum(self.slot_columns**2, axis=0)
        self.sums = TrigSums(self.theta, family.orders)
        total = float(np.sum(self.size))
        self.raw = np.full((len(family.orders), 2), total / 2.0)
        self.rivals = np.abs(family.orders - np.round(family.orders)) < 1e-9

    def shared(self, space: Space, vectors: Array) -> Array:
        """Compute X'v, shape (orders, 2, c)."""
        sums = self.sums.of(space.by_reading(self.slot_columns, vectors))
        return np.stack([sums.real, sums.imag], axis=1)

    def gram(self, space: Space) -> Array:
        """Compute X'X from the sums at twice the order, shape (orders, 2, 2)."""
        twice = TrigSums(self.theta, 2.0 * self.family.orders).of(self.size[:, None])[:, 0]
        total = np.sum(self.size)
        gram = np.empty((len(twice), 2, 2))
        gram[:, 0, 0] = 0.5 * (total + twice.real)
        gram[:, 1, 1] = 0.5 * (total - twice.real)
        gram[:, 0, 1] = gram[:, 1, 0] = 0.5 * twice.imag
        return gram

    def choose(self, gain: Array, scores: Scores) -> int:
        """Choose the best order: whole, unless the readings insist that it is not."""
        orders = self.family.orders
        best = int(np.argmax(gain))
        whole = int(np.argmin(np.abs(orders - max(1, round(orders[best])))))
        lost = scores.space.rows * np.log(
            max(scores.rss - gain[whole], 1e-300) / max(scores.rss - gain[best], 1e-300)
        )
        return whole if lost < WHOLE_ORDER else best

    def alike(self, place: int) -> int:
        """Count the orders that are as likely as this one.

        Half the weight goes to the low whole orders, where eccentric wheels are, half to all orders.
        """
        order = self.family.orders[place]
        low = order <= _LOW_ORDER and abs(order - round(order)) < 1e-9
        return 2 * _LOW_ORDER if low else 2 * len(self.family.orders)

    def place_of(self, effect: Effect) -> int:
        """Find the place nearest to the order of an effect of this family."""
        return int(np.argmin(np.abs(self.family.orders - effect.shape["order"])))

    def effect(self, place: int) -> Effect:
        """Return the effect at a place of the scan."""
        return self.family.at(float(self.family.orders[place]))


_NODES = 6  # stretches of the campaign at whose ends creeps begin and end
_FEWEST_NODES = 2  # of them that a creep lasts: what is over sooner is a step


@dataclass(frozen=True)
class Steps(_Scan):
    """A family of candidates: several slots step together at one reading.

    Attributes
    ----------
    every : array
        Ranks at which a step may be.
    slowly : callable
        Builds the same effect as a creep between two ranks.
    scanned : int
        Approximate number of ranks that are scanned, evenly spread. The others are candidates when a
        step is refined.
    """

    label: str
    slots: tuple[str, ...]
    every: Array
    at: Callable[[float], Effect]
    slowly: Callable[[float, float], Effect]
    scanned: int = 250

    @property
    def ranks(self) -> Array:
        """Ranks that are scanned."""
        return self.every[:: max(1, len(self.every) // self.scanned)]

    @property
    def stretches(self) -> list[tuple[float, float]]:
        """Ranks between which a creep begins and ends, every two of a few that are far enough apart."""
        nodes = self.every[np.linspace(0, len(self.every) - 1, _NODES + 1).astype(int)]
        return [(a, b) for i, a in enumerate(nodes) for b in nodes[i + _FEWEST_NODES :] if b > a]

    def scores(self, space: Space) -> FamilyScores:
        """Score the family in a space."""
        return StepScores(self, space)

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Steps, Effect]]) -> list[Effect]:
        """Move every change point to the reading nearby that explains most."""
        return [family._moved(space, effect) for family, effect in own]

    def _moved(self, space: Space, effect: Effect) -> Effect:
        here = int(np.searchsorted(self.every, effect.shape["rank"]))
        reach = max(3, 2 * len(self.every) // self.scanned)
        near = self.every[max(0, here - reach) : here + reach + 1]
        scores = Scores([replace(self, every=near, scanned=len(near))], space)
        scores.move(*space.own_direction(effect), enters=False)
        return scores.best_of(0).effect


class StepScores:
    """Scores of a family of steps over its change points, and behind them of the creeps."""

    bounds = None
    twins = True

    def __init__(self, family: Steps, space: Space) -> None:
        self.label = family.label
        self.family = family
        self.order = np.argsort(space.fitted.readings.conditions.order)
        ranks = space.fitted.readings.conditions.order[self.order]
        self.first = np.searchsorted(ranks, family.ranks)
        conditions = space.fitted.readings.conditions
        self.creeps = [family.slowly(*stretch) for stretch in family.stretches]
        moves = [effect.terms[0].regressor.evaluate(conditions) for effect in self.creeps]
        self.creeping = np.reshape(np.asarray(moves), (len(moves), len(conditions)))
        self.slot_columns = [space.slot(slot) for slot in family.slots]
        self.raw = np.stack([self._squares(np.sum(g**2, axis=0)) for g in self.slot_columns], axis=1)
        self.rivals = np.arange(len(self.raw)) >= len(family.ranks)

    def _sums(self, values: Array, weights: Array) -> Array:
        """Sum values (n, c) over the readings from every rank on, then by the weights of creeps.

        The shape is (places, c).
        """
        tail = np.cumsum(values[self.order[::-1]], axis=0)[::-1]
        return np.concatenate([tail[self.first], weights @ values])

    def _squares(self, values: Array) -> Array:
        """Sum products (n,) of two columns, shape (places,)."""
        return self._sums(values[:, None], self.creeping**2)[:, 0]

    def shared(self, space: Space, vectors: Array) -> Array:
        """Compute X'v, shape (places, slots, c)."""
        values = [space.by_reading(g, vectors) for g in self.slot_columns]
        return np.stack([self._sums(each, self.creeping) for each in values], axis=1)

    def gram(self, space: Space) -> Array:
        """Compute X'X, shape (places, slots, slots)."""
        p = len(self.slot_columns)
        gram = np.empty((len(self.raw), p, p))
        for i, g in enumerate(self.slot_columns):
            for j, h in enumerate(self.slot_columns[: i + 1]):
                gram[:, i, j] = gram[:, j, i] = self._squares(np.sum(g * h, axis=0))
        return gram

    def choose(self, gain: Array, scores: Scores) -> int:
        """Choose the best change point."""
        return int(np.argmax(gain[: len(self.family.ranks)]))

    def alike(self, place: int) -> int:
        """Count all change points, since any is as likely as any other."""
        return len(self.family.ranks)

    def place_of(self, effect: Effect) -> int:
        """Find the place nearest to the change point of an effect of this family."""
        return int(np.argmin(np.abs(self.family.ranks - effect.shape["rank"])))

    def effect(self, place: int) -> Effect:
        """Return the effect at a place of the scan."""
        ranks = self.family.ranks
        return self.family.at(float(ranks[place])) if place < len(ranks) else self.creeps[place - len(ranks)]
