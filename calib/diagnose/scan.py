"""Scores of everything the library offers, projected on what the model does not explain.

For a candidate with columns X (rows, p): A = X'PX, b = X'r, and the fall of the residual sum of squares that it
would bring is b' A^-1 b. Scanned families never form their columns: the sums that make up A and b are

    harmonics   sums over readings of u exp(i H theta), for all orders H at once by a Fourier transform;
    steps       sums over the readings from a rank on: one cumulative sum.

Other shapes, such as time constants, are scanned at few places and by their columns. A place at which physics forbids
the estimate A^-1 b (`calib.diagnose.physics`) scores nothing.
Adding or removing a direction q (unit vector) from the model updates A and b by what q shares with X.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from calib.diagnose.evidence import WHOLE_ORDER, evidence_of
from calib.diagnose.physics import bounds_of, impossible
from calib.diagnose.space import Space
from calib.diagnose.trigsums import TrigSums
from calib.effects.effect import Candidate, Effect, Harmonics, Offer, Shapes, Steps
from calib.kinematics import Array
from calib.units import to_internal

_LOW_ORDER = 6
ABSORBED = 1e-6  # share of a column's square below which the model absorbs it


class FixedScores:
    """Scores of one candidate with nothing to scan."""

    def __init__(self, candidate: Candidate, space: Space) -> None:
        self.label = candidate.label
        self.candidate = candidate
        self.columns = space.effect_columns(candidate.effect)
        self.raw = np.sum(self.columns**2, axis=0)[None, :]
        self.bounds = bounds_of(candidate.effect)

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
        """One place, one try."""
        return 1

    def place_of(self, effect: Effect) -> int:
        """The only place."""
        return 0

    def effect(self, place: int) -> Effect:
        """The effect at a place of the scan."""
        return self.candidate.effect


class HarmonicScores:
    """Scores of a family of harmonics over its orders."""

    bounds = None

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


class StepScores:
    """Scores of a family of steps over its change points."""

    bounds = None

    def __init__(self, family: Steps, space: Space) -> None:
        self.label = family.label
        self.family = family
        self.order = np.argsort(space.fitted.readings.conditions.order)
        ranks = space.fitted.readings.conditions.order[self.order]
        self.first = np.searchsorted(ranks, family.ranks)
        self.slot_columns = [space.slot(slot) for slot in family.slots]
        self.raw = np.stack(
            [self._from_here(np.sum(g**2, axis=0)[:, None])[:, 0] for g in self.slot_columns], axis=1
        )

    def _from_here(self, values: Array) -> Array:
        """(ranks, c): sums of (n, c) values over the readings from every rank on."""
        tail = np.cumsum(values[self.order[::-1]], axis=0)[::-1]
        return tail[self.first]

    def shared(self, space: Space, vectors: Array) -> Array:
        """(ranks, slots, c): X'v."""
        return np.stack([self._from_here(space.by_reading(g, vectors)) for g in self.slot_columns], axis=1)

    def gram(self, space: Space) -> Array:
        """(ranks, slots, slots): X'X."""
        p = len(self.slot_columns)
        gram = np.empty((len(self.first), p, p))
        for i, g in enumerate(self.slot_columns):
            for j, h in enumerate(self.slot_columns[: i + 1]):
                gram[:, i, j] = gram[:, j, i] = self._from_here(np.sum(g * h, axis=0)[:, None])[:, 0]
        return gram

    def choose(self, gain: Array, scores: Scores) -> int:
        """The best change point."""
        return int(np.argmax(gain))

    def alike(self, place: int) -> int:
        """Any change point is as likely as any other."""
        return len(self.family.ranks)

    def place_of(self, effect: Effect) -> int:
        """The place nearest to the change point of an effect of this family."""
        return int(np.argmin(np.abs(self.family.ranks - effect.shape["rank"])))

    def effect(self, place: int) -> Effect:
        """The effect at a place of the scan."""
        return self.family.at(float(self.family.ranks[place]))


class ShapeScores:
    """Scores of a family over a shape constant, by the columns of every place."""

    def __init__(self, family: Shapes, space: Space) -> None:
        self.label = family.label
        self.family = family
        self.effects = [family.at(float(value)) for value in family.values]
        self.columns = np.stack([space.effect_columns(effect).T for effect in self.effects])
        self.raw = np.sum(self.columns**2, axis=2)
        self.bounds = bounds_of(self.effects[0])

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


@dataclass(frozen=True)
class Score:
    """One candidate at one place of its scan: fall of the residual sum of squares, columns that count, evidence."""

    label: str
    effect: Effect
    gain: float
    freedom: int
    multiplicity: int
    evidence: float


class Scores:
    """A and b of every offer, kept up to date while directions enter or leave the model."""

    def __init__(self, offers: Sequence[Offer], space: Space) -> None:
        self.space = space
        self.rss, self.freedom = space.rss, space.freedom
        self.families: list[FixedScores | HarmonicScores | StepScores | ShapeScores] = []
        for offer in offers:
            if isinstance(offer, Candidate):
                self.families.append(FixedScores(offer, space))
            elif isinstance(offer, Harmonics):
                self.families.append(HarmonicScores(offer, space))
            elif isinstance(offer, Steps):
                self.families.append(StepScores(offer, space))
            else:
                self.families.append(ShapeScores(offer, space))
        self.a = [family.gram(space) for family in self.families]
        residual = space.residual.reshape(-1, 1)
        self.b = [family.shared(space, residual)[:, :, 0] for family in self.families]
        for family, a in zip(self.families, self.a, strict=True):
            shared = family.shared(space, space.basis_of_readings)
            a -= shared @ shared.transpose(0, 2, 1)

    def copy(self) -> Scores:
        """An independent copy of the state."""
        twin = object.__new__(Scores)
        twin.space, twin.families = self.space, self.families
        twin.rss, twin.freedom = self.rss, self.freedom
        twin.a, twin.b = [a.copy() for a in self.a], [b.copy() for b in self.b]
        return twin

    def move(self, directions: Array, coefficients: Array, *, enters: bool) -> None:
        """Orthonormal directions (rows, p) enter or leave the model, with the coefficients (p,) of the data on them."""
        sign = -1.0 if enters else 1.0
        for i, family in enumerate(self.families):
            shared = family.shared(self.space, directions)
            self.a[i] = self.a[i] + sign * shared @ shared.transpose(0, 2, 1)
            self.b[i] = self.b[i] + sign * shared @ coefficients
        self.rss += sign * float(coefficients @ coefficients)
        self.freedom += int(sign) * len(coefficients)

    def gains(self, index: int) -> tuple[Array, Array]:
        """(places,) gain and number of columns that count, of one family; none where physics forbids the estimate."""
        a, b, family = self.a[index], self.b[index], self.families[index]
        gain, freedom = gain_of(a, b, family.raw)
        if family.bounds is not None:
            values, variance = estimate_of(a, b, family.raw)
            allowed = ~impossible(family.bounds, values, np.sqrt(variance * self.noise))
            gain, freedom = np.where(allowed, gain, 0.0), np.where(allowed, freedom, 0)
        return gain, freedom

    @property
    def noise(self) -> float:
        """Variance of the whitened residual, at least that declared."""
        return max(self.rss / max(self.freedom, 1), 1.0)

    def multiplicity(self, index: int, place: int) -> int:
        """How many tries a place stands for: all families x the places of its scan that are as likely as it."""
        return len(self.families) * self.families[index].alike(place)

    def multiplicity_of(self, effect: Effect) -> int:
        """How many tries stand behind an effect of the model."""
        for index, family in enumerate(self.families):
            if effect.label == family.label or effect.label.startswith(family.label + ":"):
                return self.multiplicity(index, family.place_of(effect))
        return len(self.families)

    def best_of(self, index: int) -> Score:
        """The best place of one family."""
        gain, freedom = self.gains(index)
        place = self.families[index].choose(gain, self)
        return self.at(index, place, float(gain[place]), int(freedom[place]))

    def at(self, index: int, place: int, gain: float, freedom: int) -> Score:
        """The score of one place of one family."""
        family = self.families[index]
        effect = family.effect(place)
        size = usual_sizes(effect)
        information = self.a[index][place] * np.outer(size, size) / self.noise
        volume = float(np.linalg.slogdet(np.eye(len(size)) + information)[1])
        tries = self.multiplicity(index, place)
        evidence = evidence_of(gain, volume, self.rss, self.space.rows, tries)
        return Score(family.label, effect, gain, freedom, tries, evidence)

    def own(self, effect: Effect, gain: float) -> float:
        """Evidence of an effect that these scores do not hold, `gain` being what it alone explains.

        Its covariance for unit noise is (A + s^2 S^-2)^-1, so the volume is -log det(S^-1 C S^-1 s^2).
        """
        positions = self.space.fitted.model.positions(effect)
        live = [k for k, i in enumerate(positions) if self.space.covariance[i, i] > 0.0]
        size = usual_sizes(effect)[live]
        at = [positions[k] for k in live]
        held = self.space.covariance[np.ix_(at, at)] / np.outer(size, size) * self.noise
        volume = max(-float(np.linalg.slogdet(held)[1]), 0.0)
        return evidence_of(gain, volume, self.rss, self.space.rows, self.multiplicity_of(effect))


def usual_sizes(effect: Effect) -> Array:
    """(p,) expected sizes of an effect's parameters, internal units; those without one count as 1 of their unit."""
    return np.array([to_internal(1.0 if p.size is None else p.size, p.unit) for p in effect.parameters])


def gain_of(a: Array, b: Array, raw: Array) -> tuple[Array, Array]:
    """b'A^-1 b for a stack (c, p, p), (c, p); columns are scaled by their raw squares (c, p).

    Directions of which less than a millionth is left after projection do not count: the model absorbs them.
    Returns gains (c,) and the number of directions that count (c,).
    """
    scale = 1.0 / np.sqrt(np.maximum(raw, 1e-300))
    a, b = a * scale[:, :, None] * scale[:, None, :], b * scale
    if a.shape[1] == 2:
        return _gain_of_two(a, b)
    values, vectors = np.linalg.eigh(a)
    along = np.einsum("cij,ci->cj", vectors, b)
    counts = values > ABSORBED
    return np.sum(np.where(counts, along**2 / np.where(counts, values, 1.0), 0.0), axis=1), counts.sum(axis=1)


def estimate_of(a: Array, b: Array, raw: Array) -> tuple[Array, Array]:
    """A^-1 b (c, p) and its variance for unit noise (c, p), of the directions that `gain_of` counts; else 0."""
    scale = 1.0 / np.sqrt(np.maximum(raw, 1e-300))
    values, vectors = np.linalg.eigh(a * scale[:, :, None] * scale[:, None, :])
    inverse = np.where(values > ABSORBED, 1.0 / np.maximum(values, ABSORBED), 0.0)
    along = np.einsum("cij,ci->cj", vectors, b * scale)
    estimate = np.einsum("cij,cj->ci", vectors, inverse * along)
    return estimate * scale, np.einsum("cij,cj->ci", vectors**2, inverse) * scale**2


def _gain_of_two(a: Array, b: Array) -> tuple[Array, Array]:
    """The same for two columns, written out: harmonics are by far the most numerous."""
    middle, half = 0.5 * (a[:, 0, 0] + a[:, 1, 1]), 0.5 * (a[:, 0, 0] - a[:, 1, 1])
    radius = np.hypot(half, a[:, 0, 1])
    angle = 0.5 * np.arctan2(a[:, 0, 1], half)
    c, s = np.cos(angle), np.sin(angle)
    values = np.stack([middle + radius, middle - radius])
    along = np.stack([c * b[:, 0] + s * b[:, 1], c * b[:, 1] - s * b[:, 0]])
    counts = values > ABSORBED
    return np.sum(np.where(counts, along**2 / np.where(counts, values, 1.0), 0.0), axis=0), counts.sum(axis=0)
