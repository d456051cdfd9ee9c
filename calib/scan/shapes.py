"""Effects of one shape constant, such as a time constant: scanned at a few places, refined between them.

A Gauss-Newton step in the logarithm of the constant moves it, to whole units.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.model.effect import Effect
from calib.scan.physics import bounds_of
from calib.scan.scores import FamilyScores, Scores
from calib.scan.space import Space

_LONGEST_RATIO = 0.25  # by how much, in its logarithm, a shape constant may move at once


@dataclass(frozen=True)
class Shapes:
    """A family of candidates of one shape constant, `key` in their `shape`, scanned over a few `values`.

    limits: between which the constant is refined, to whole units of it.
    """

    label: str
    key: str
    values: Array
    at: Callable[[float], Effect]
    limits: tuple[float, float]

    def scores(self, space: Space) -> FamilyScores:
        """The scores of the family in a space."""
        return ShapeScores(self, space)

    def made(self, effect: Effect) -> bool:
        """Whether an effect is one of this family."""
        return effect.label == self.label

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Shapes, Effect]]) -> list[Effect]:
        """The effects with better constants, in whole units."""
        return [family._better(space, effect) for family, effect in own]

    def _better(self, space: Space, effect: Effect) -> Effect:
        """The effect after a Gauss-Newton step of the logarithm; its derivative by differences, since the columns are
        cheap."""
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


class ShapeScores:
    """Scores of a family over a shape constant, by the columns of every place."""

    twins = True

    def __init__(self, family: Shapes, space: Space) -> None:
        self.label = family.label
        self.family = family
        self.effects = [family.at(float(value)) for value in family.values]
        self.columns = np.stack([space.effect_columns(effect).T for effect in self.effects])
        self.raw = np.sum(self.columns**2, axis=2)
        self.bounds = bounds_of(self.effects[0])
        self.rivals = np.zeros(len(self.effects), dtype=bool)

    def shared(self, space: Space, vectors: Array) -> Array:
        """(places, p, c): X'v."""
        return self.columns @ vectors

    def gram(self, space: Space) -> Array:
        """(places, p, p): X'X."""
        return self.columns @ self.columns.transpose(0, 2, 1)

    def choose(self, gain: Array, scores: Scores) -> int:
        """The best place."""
        return int(np.argmax(gain))

    def alike(self, place: int) -> int:
        """Any place is as likely as any other."""
        return len(self.effects)

    def place_of(self, effect: Effect) -> int:
        """The place nearest to the shape of an effect of this family."""
        return int(np.argmin(np.abs(self.family.values - effect.shape[self.family.key])))

    def effect(self, place: int) -> Effect:
        """The effect at a place of the scan."""
        return self.effects[place]
