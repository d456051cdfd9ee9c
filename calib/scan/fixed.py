"""A candidate without a scan, and its scores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.model.effect import Effect
from calib.scan.physics import bounds_of
from calib.scan.scores import FamilyScores, Scores
from calib.scan.space import Space


@dataclass(frozen=True)
class Candidate:
    """An effect that the diagnosis may propose as it is: nothing about it is scanned."""

    effect: Effect

    @property
    def label(self) -> str:
        """Label of the effect."""
        return self.effect.label

    def scores(self, space: Space) -> FamilyScores:
        """The scores of the family in a space."""
        return FixedScores(self, space)

    def made(self, effect: Effect) -> bool:
        """Whether an effect is one of this family."""
        return effect.label == self.label

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Candidate, Effect]]) -> list[Effect]:
        """The effects as they are: nothing of them was scanned."""
        return [effect for _, effect in own]


class FixedScores:
    """Scores of one candidate with nothing to scan."""

    twins = True

    def __init__(self, candidate: Candidate, space: Space) -> None:
        self.label = candidate.label
        self.candidate = candidate
        self.columns = space.effect_columns(candidate.effect)
        self.raw = np.sum(self.columns**2, axis=0)[None, :]
        self.bounds = bounds_of(candidate.effect)
        self.rivals = np.zeros(1, dtype=bool)

    def shared(self, space: Space, vectors: Array) -> Array:
        """(1, p, c): X'v for c row vectors (rows, c)."""
        return (self.columns.T @ vectors)[None]

    def gram(self, space: Space) -> Array:
        """(1, p, p): X'X."""
        return (self.columns.T @ self.columns)[None]

    def choose(self, gain: Array, scores: Scores) -> int:
        """The only place."""
        return 0

    def alike(self, place: int) -> int:
        """Number of places that are as likely as this one: itself."""
        return 1

    def place_of(self, effect: Effect) -> int:
        """The only place."""
        return 0

    def effect(self, place: int) -> Effect:
        """The effect at a place of the scan."""
        return self.candidate.effect
