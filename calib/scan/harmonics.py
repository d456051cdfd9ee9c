"""Harmonics of a joint: scanned over all orders at once by a Fourier transform, refined to orders between them.

The derivative of A cos(H theta) + B sin(H theta) by H is theta (B cos - A sin). One Gauss-Newton step for all
orders at once, projected on what the model leaves, moves them; an order whose nearest whole number lies within
what the readings determine becomes whole.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.model.effect import Effect
from calib.scan.evidence import WHOLE_ORDER
from calib.scan.scores import FamilyScores, Scores
from calib.scan.space import Space
from calib.scan.trigsums import TrigSums

_LOW_ORDER = 6
_LONGEST_STEP = 0.3  # cycles a turn
_RESOLUTION = 0.6  # cycles over the measured range within which two orders of a joint are one effect


@dataclass(frozen=True)
class Harmonics:
    """A family of candidates: cos and sin of order x theta of one joint on some slots, scanned over `orders`.

    Labels of its effects begin with its own and a colon. lowest: order down to which one may be refined.
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
        """The scores of the family in a space."""
        return HarmonicScores(self, space)

    def made(self, effect: Effect) -> bool:
        """Whether an effect is one of this family."""
        return effect.label.startswith(f"{self.label}:")

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Harmonics, Effect]]) -> list[Effect]:
        """The effects at better orders, by one step for all of them."""
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
        """(size,) derivative of the readings by the order of an effect."""
        order = effect.shape["order"]
        theta = space.fitted.readings.conditions.joints[:, self.joint - 1]
        a, b = space.fitted.estimate[space.fitted.model.positions(effect)]
        drive = theta * (b * np.cos(order * theta) - a * np.sin(order * theta))
        return np.sum([weight * (space.slot(slot) * drive).ravel() for slot, weight in self.slots], axis=0)


def one_order(space: Space, one: Effect, other: Effect) -> bool:
    """Whether two harmonics of one joint, on the same slots, differ by less than the measured range resolves."""
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
        """(orders, 2, c): X'v."""
        sums = self.sums.of(space.by_reading(self.slot_columns, vectors))
        return np.stack([sums.real, sums.imag], axis=1)

    def gram(self, space: Space) -> Array:
        """(orders, 2, 2): X'X, from the sums at twice the order."""
        twice = TrigSums(self.theta, 2.0 * self.family.orders).of(self.size[:, None])[:, 0]
        total = np.sum(self.size)
        gram = np.empty((len(twice), 2, 2))
        gram[:, 0, 0] = 0.5 * (total + twice.real)
        gram[:, 1, 1] = 0.5 * (total - twice.real)
        gram[:, 0, 1] = gram[:, 1, 0] = 0.5 * twice.imag
        return gram

    def choose(self, gain: Array, scores: Scores) -> int:
        """The best order: whole, unless the readings insist that it is not."""
        orders = self.family.orders
        best = int(np.argmax(gain))
        whole = int(np.argmin(np.abs(orders - max(1, round(orders[best])))))
        lost = scores.space.rows * np.log(
            max(scores.rss - gain[whole], 1e-300) / max(scores.rss - gain[best], 1e-300)
        )
        return whole if lost < WHOLE_ORDER else best

    def alike(self, place: int) -> int:
        """Half the weight goes to the low whole orders, where eccentric wheels are, half to all others."""
        order = self.family.orders[place]
        low = order <= _LOW_ORDER and abs(order - round(order)) < 1e-9
        return 2 * _LOW_ORDER if low else 2 * len(self.family.orders)

    def place_of(self, effect: Effect) -> int:
        """The place nearest to the order of an effect of this family."""
        return int(np.argmin(np.abs(self.family.orders - effect.shape["order"])))

    def effect(self, place: int) -> Effect:
        """The effect at a place of the scan."""
        return self.family.at(float(self.family.orders[place]))
