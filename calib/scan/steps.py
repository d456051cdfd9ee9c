"""Steps at a reading: scanned at evenly spread change points by one cumulative sum, refined to the reading.

Beside them stand creeps between two readings that are far apart. They are never chosen: they are rivals of the best
step where they fit nearly as well, since then the readings do not show that it happened at once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.model.effect import Effect
from calib.scan.scores import FamilyScores, Scores
from calib.scan.space import Space

_NODES = 6  # stretches of the campaign at whose ends creeps begin and end
_FEWEST = 2  # of them that a creep lasts: what is over sooner is a step


@dataclass(frozen=True)
class Steps:
    """A family of candidates: several slots step together at one reading, one of the ranks of `every`.

    slowly: the same creeping between two ranks. scanned: about how many of the ranks are scanned, evenly spread; the
    others come into question when one is refined.
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
        return [(a, b) for i, a in enumerate(nodes) for b in nodes[i + _FEWEST :] if b > a]

    def scores(self, space: Space) -> FamilyScores:
        """The scores of the family in a space."""
        return StepScores(self, space)

    def made(self, effect: Effect) -> bool:
        """Whether an effect is one of this family."""
        return effect.label == self.label

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Steps, Effect]]) -> list[Effect]:
        """The effects with every change point moved to the reading that explains most, near where it was."""
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
        """(places, c): sums of (n, c) values over the readings from every rank on, then by the weights of creeps."""
        tail = np.cumsum(values[self.order[::-1]], axis=0)[::-1]
        return np.concatenate([tail[self.first], weights @ values])

    def _squares(self, values: Array) -> Array:
        """(places,): sums of (n,) products of two columns."""
        return self._sums(values[:, None], self.creeping**2)[:, 0]

    def shared(self, space: Space, vectors: Array) -> Array:
        """(places, slots, c): X'v."""
        values = [space.by_reading(g, vectors) for g in self.slot_columns]
        return np.stack([self._sums(each, self.creeping) for each in values], axis=1)

    def gram(self, space: Space) -> Array:
        """(places, slots, slots): X'X."""
        p = len(self.slot_columns)
        gram = np.empty((len(self.raw), p, p))
        for i, g in enumerate(self.slot_columns):
            for j, h in enumerate(self.slot_columns[: i + 1]):
                gram[:, i, j] = gram[:, j, i] = self._squares(np.sum(g * h, axis=0))
        return gram

    def choose(self, gain: Array, scores: Scores) -> int:
        """The best change point."""
        return int(np.argmax(gain[: len(self.family.ranks)]))

    def alike(self, place: int) -> int:
        """Any change point is as likely as any other."""
        return len(self.family.ranks)

    def place_of(self, effect: Effect) -> int:
        """The place nearest to the change point of an effect of this family."""
        return int(np.argmin(np.abs(self.family.ranks - effect.shape["rank"])))

    def effect(self, place: int) -> Effect:
        """The effect at a place of the scan."""
        ranks = self.family.ranks
        return self.family.at(float(ranks[place])) if place < len(ranks) else self.creeps[place - len(ranks)]
