"""Scores of all candidate effects of the library, projected on the residuals of the model.

For a candidate with columns X (rows, p): A = X'PX, b = X'r, and the fall of the residual sum of squares
that it would bring is b' A^-1 b. Scanned families never form their columns: the sums that make up A and
b are

    harmonics   sums over readings of u exp(i H theta), for all orders H at once by a Fourier transform;
    steps       sums over the readings from a rank on: one cumulative sum.

Other shapes, such as time constants, are scanned at few places and by their columns. A place at which
physics forbids the estimate A^-1 b scores nothing. Adding or removing a direction q (unit vector) from
the model updates A and b by the product of q with X.

Let J be the whitened Jacobian of the fitted model (priors and distances between balls stacked below it),
and J = QR. A candidate's columns X count only by P X, P = I - QQ': the part that the base model absorbs
is no evidence. The residual r is orthogonal to J already.

Evidence is n log(RSS before / after) - sum of log(1 + mu_j) - 2 log(multiplicity). It is twice the log
of the evidence; larger is better. mu_j are the eigenvalues of S A S / s^2. They compare the information
of the readings on the candidate's columns (A) with the expected sizes (S), in noise s.

BIC charges log n for every column, also for one that the base model absorbs almost completely. It is
therefore certain of the simpler of two explanations that the readings cannot distinguish. This evidence
charges only the real effect of a column. With the tries counted, nothing is claimed on faultless sets
(plain BIC claims in 40 to 95 % of them). Sources: Chen and Chen 2008 (extended BIC), MacKay 1992 (Occam
factor).

Physical bounds: an estimate that exceeds the bounds of its parameter by more than its noise excludes the
effect. A negative gap, or a gear that turns against its load, means that the readings show another
effect that looks similar. An estimate within its noise of the bound is accepted. The bounds are those
that each effect declares in its own file.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, Self

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular
from scipy.special import fdtrc

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.fit.identification import IdentificationFit
from calib.fit.least_squares import jacobian, orthonormal
from calib.model.effect import Effect
from calib.model.model import BoundModel, ties
from calib.model.regressors import Regressor
from calib.units import to_internal

CLAIM = 0.002  # chance that a complete data set yields a claim
CLASS_WIDTH = 6.0  # evidence within which two explanations cannot be distinguished
WHOLE_ORDER = 10.0  # evidence that a harmonic order off the whole numbers must gain to be believed


def p_value(
    gain: float, columns: int, rss: float, freedom: int, multiplicity: float, counts: float = 1.0
) -> float:
    """Compute the p-value, over all tries, of a reduction of `rss` by `gain`.

    `rss` is the value before the reduction. `counts` is the share of the gain that counts, if noise is
    larger along it than elsewhere. The p-value is 1 if nothing is left to test.
    """
    left = freedom - columns
    if columns == 0 or left <= 0 or gain <= 0.0:
        return 1.0
    ratio = (counts * gain / columns) / (max(rss - gain, 1e-300) / left)
    return min(1.0, float(fdtrc(columns, left, ratio)) * multiplicity)


def evidence_of(gain: float, volume: float, rss: float, rows: int, multiplicity: float) -> float:
    """Compute the evidence of a candidate; `volume` is the sum of log(1 + mu_j)."""
    left = max(rss - gain, 1e-300)
    return rows * math.log(rss / left) - volume - 2.0 * math.log(multiplicity)


_NOISE = 3.0  # standard errors beyond a bound that rule an effect out


def bounds_of(effect: Effect) -> Array | None:
    """Return lowest and highest value of every parameter, shape (p, 2), internal units.

    Returns None if nothing is bounded.
    """
    bounds = np.array([parameter.bounds for parameter in effect.parameters])
    return bounds if np.any(np.isfinite(bounds)) else None


def impossible(bounds: Array, values: Array, errors: Array) -> NDArray[np.bool_]:
    """Test whether any of the values (..., p) lies outside the bounds (p, 2), shape (...,).

    `errors` (..., p) are their standard errors.
    """
    low, high = bounds.T
    beyond = (values + _NOISE * errors < low) | (values - _NOISE * errors > high)
    return np.any(beyond, axis=-1)


@dataclass(frozen=True)
class Space:
    """The whitened rows of a fit.

    They are k rows per reading (k, n), flattened: `size` = k n, of which `rows` were measured.
    """

    fitted: IdentificationFit
    frames: Frames
    residual: Array  # (k, n)
    held: Array  # (size + a + q,): residuals of the readings, of the priors, of the distances between balls
    basis: Array  # (size + a + q, a): Q, over all of these
    covariance: Array  # (m, m) of the estimate for unit noise
    columns: Array  # (size, m)
    triangle: Array  # (a, a): R of the active columns of readings and priors, Q R

    @classmethod
    def of(cls, fitted: IdentificationFit) -> Space:
        """Build the space of a fit."""
        design = BoundModel(fitted.model, fitted.readings.conditions)
        observed = fitted.readings.observed
        frames = design.frames(fitted.estimate)
        columns = jacobian(design, observed, frames)
        active, prior = np.diag(fitted.covariance) > 0.0, fitted.prior
        left, tied = (max(fitted.noise_scale, 1.0) * part for part in ties(fitted.model, fitted.estimate))
        size = np.sqrt(np.sum(columns**2, axis=0) + prior**2 + np.sum(tied**2, axis=0))[active]
        stacked = np.vstack(
            [columns[:, active] / size, np.diag(prior[active] / size), tied[:, active] / size]
        )
        basis, r = orthonormal(stacked)
        inverse = solve_triangular(r, np.eye(len(r))) / size[:, None]
        covariance = np.zeros((len(active), len(active)))
        covariance[np.ix_(active, active)] = inverse @ inverse.T
        residual = observed.residual(frames)
        held = np.concatenate(
            [residual.ravel(), -(prior * (fitted.estimate - fitted.model.prior_mean))[active], left]
        )
        return cls(fitted, frames, residual, held, basis, covariance, columns, r * size)

    @property
    def size(self) -> int:
        """Number of whitened rows, with those (zero) that were not measured."""
        return self.residual.size

    @property
    def rows(self) -> int:
        """Number of whitened rows that were measured."""
        return self.fitted.readings.observed.count

    @property
    def rss(self) -> float:
        """Sum of squares, priors included."""
        return float(self.held @ self.held)

    @property
    def basis_of_readings(self) -> Array:
        """Rows of Q that belong to the readings, shape (size, a)."""
        return self.basis[: self.size]

    @property
    def freedom(self) -> int:
        """Degrees of freedom left."""
        return self.rows - self.basis.shape[1]

    def slot(self, slot: str) -> Array:
        """Differentiate the whitened readings for a unit of a slot, shape (k, n).

        The slot is the same in all readings of a visit.
        """
        observed = self.fitted.readings.observed
        return observed.by_visit(observed.column(self.frames, slot))

    def effect_columns(self, effect: Effect) -> Array:
        """Compute the whitened columns of an effect inside or outside the model, shape (size, p)."""
        position = {p.name: i for i, p in enumerate(effect.parameters)}
        conditions, observed = self.fitted.readings.conditions, self.fitted.readings.observed
        columns = np.zeros((len(effect.parameters), *self.residual.shape))
        slots: dict[str, Array] = {}
        drives: dict[Regressor, Array | float] = {}
        for term in effect.terms:
            if term.slot not in slots:
                slots[term.slot] = observed.column(self.frames, term.slot)
            if term.regressor not in drives:
                drives[term.regressor] = term.regressor.evaluate(conditions)
            drive = term.weight * drives[term.regressor]
            columns[position[term.parameter]] += slots[term.slot] * drive
        return observed.by_visit(columns).reshape(len(columns), -1).T

    def pulled(self, rows: Array) -> Array:
        """Apply the whitening by visit to c vectors (size, c).

        The product of columns that are whitened by reading with the result equals the product of the
        same columns, whitened by visit, with the vectors.
        """
        observed = self.fitted.readings.observed
        if observed.shared is None:
            return rows
        return observed.by_visit(rows.T.reshape(-1, *self.residual.shape)).reshape(rows.shape[1], -1).T

    def by_reading(self, slot_columns: Array, rows: Array) -> Array:
        """Sum slot column x vector over a reading's k rows, for c row vectors (size, c), (n, c)."""
        k, n = slot_columns.shape
        return np.einsum("kn,knc->nc", slot_columns, rows.reshape(k, n, -1))

    def own_direction(self, effect: Effect) -> tuple[Array, Array]:
        """Find the space that one effect of the model alone explains.

        Returns orthonormal vectors (size, p) and the coefficients (p,) in it. Without the part that all
        others explain, the columns of the effect are X C_e (C = covariance, C_e its columns of the
        effect). Their Gram matrix is C_ee; so q = X C_e L^-T and q'r = L^-1 beta, C_ee = L L'.
        """
        positions = self.fitted.model.positions(effect)
        live = [i for i in positions if self.covariance[i, i] > 0.0]
        lower = np.linalg.cholesky(self.covariance[np.ix_(live, live)])
        direction = solve_triangular(lower, (self.columns @ self.covariance[:, live]).T, lower=True).T
        return direction, solve_triangular(lower, self.fitted.estimate[live], lower=True)

    def forbids(self, effect: Effect) -> bool:
        """Test whether the estimate of an effect lies beyond its physical bounds.

        The effect belongs to the model. It must exceed the bounds by more than its noise.
        """
        bounds = bounds_of(effect)
        if bounds is None:
            return False
        at = self.fitted.model.positions(effect)
        noise = max(self.rss / max(self.freedom, 1), 1.0)
        errors = np.sqrt(np.diag(self.covariance)[at] * noise)
        return bool(impossible(bounds, self.fitted.estimate[at], errors))

    def own_coordinates(self, effect: Effect) -> tuple[Array, Array]:
        """Compute `own_direction` in coordinates of the basis, readings and priors together.

        Returns t (a, p) with q = Q t, and the coefficients (p,).
        """
        active = np.flatnonzero(np.diag(self.covariance) > 0.0)
        live = np.isin(active, self.fitted.model.positions(effect))
        within = self.covariance[np.ix_(active, active[live])]
        lower = np.linalg.cholesky(within[live])
        t = solve_triangular(lower, (self.triangle @ within).T, lower=True).T
        return t, solve_triangular(lower, self.fitted.estimate[active[live]], lower=True)


ABSORBED = 1e-6  # share of a column's square below which the model absorbs it


class FamilyScores(Protocol):
    """Scores of one family at the places of its scan."""

    @property
    def label(self) -> str:
        """Label of the family."""
        ...

    @property
    def raw(self) -> Array:
        """Squares of the columns before projection, shape (places, p)."""
        ...

    @property
    def bounds(self) -> Array | None:
        """Physical bounds, shape (p, 2).

        They are None if nothing is bounded, or if the estimate is not examined.
        """
        ...

    @property
    def twins(self) -> bool:
        """Whether its columns may hold all that another effect does."""
        ...

    @property
    def rivals(self) -> NDArray[np.bool_]:
        """Mask of the places that are separate rivals of the best, shape (places,).

        They count if they fit nearly as well.
        """
        ...

    def shared(self, space: Space, vectors: Array) -> Array:
        """Compute X'v for c row vectors (rows, c), shape (places, p, c)."""
        ...

    def gram(self, space: Space) -> Array:
        """Compute X'X, shape (places, p, p)."""
        ...

    def choose(self, gain: Array, scores: Scores) -> int:
        """Choose the best place, given the gain (places,) at each."""
        ...

    def alike(self, place: int) -> int:
        """Count the places that are as likely as this one."""
        ...

    def place_of(self, effect: Effect) -> int:
        """Find the place nearest to an effect of this family."""
        ...

    def effect(self, place: int) -> Effect:
        """Return the effect at a place of the scan."""
        ...


class Family(Protocol):
    """A family of candidates of the library: one effect, or many with different scanned values."""

    @property
    def label(self) -> str:
        """Label of its effect, or that with which the labels of its effects begin."""
        ...

    def scores(self, space: Space) -> FamilyScores:
        """Score the family in a space."""
        ...

    def made(self, effect: Effect) -> bool:
        """Test whether an effect is one of this family."""
        ...

    @classmethod
    def refine(cls, space: Space, own: Sequence[tuple[Self, Effect]]) -> list[Effect]:
        """Refine effects of the model from the places of the scan to their best fit.

        Each effect comes with the family that made it.
        """
        ...


@dataclass(frozen=True)
class Score:
    """A candidate at one place of its scan.

    `gain` is the reduction of the residual sum of squares, `freedom` the number of columns that count.
    """

    label: str
    effect: Effect
    gain: float
    freedom: int
    multiplicity: float
    evidence: float


class Scores:
    """A and b of every offer, kept up to date while directions enter or leave the model."""

    def __init__(self, offered: Sequence[Family], space: Space) -> None:
        self.space = space
        self.rss, self.freedom = space.rss, space.freedom
        self.families = [family.scores(space) for family in offered]
        self.shares = self._shares(space)
        self.a = [family.gram(space) for family in self.families]
        residual = space.residual.reshape(-1, 1)
        self.b = [family.shared(space, residual)[:, :, 0] for family in self.families]
        # What the next step of the fit itself would take is no candidate's gain, however little the fit left of it.
        ahead = space.basis.T @ space.held
        for family, a, b in zip(self.families, self.a, self.b, strict=True):
            shared = family.shared(space, space.basis_of_readings)
            a -= shared @ shared.transpose(0, 2, 1)
            b -= shared @ ahead

    def _shares(self, space: Space) -> dict[tuple[int, int], float]:
        """Return the share of all tries, by family and place, for effects of the robot's type."""
        return {
            (index, family.place_of(expected.place)): expected.share
            for expected in space.fitted.model.expected
            for index, family in enumerate(self.families)
            if expected.label == family.label or expected.label.startswith(family.label + ":")
        }

    def copy(self) -> Scores:
        """Copy the state independently."""
        twin = object.__new__(Scores)
        twin.space, twin.families, twin.shares = self.space, self.families, self.shares
        twin.rss, twin.freedom = self.rss, self.freedom
        twin.a, twin.b = [a.copy() for a in self.a], [b.copy() for b in self.b]
        return twin

    def move(self, directions: Array, coefficients: Array, *, enters: bool) -> None:
        """Let orthonormal directions (rows, p) enter or leave the model.

        `coefficients` (p,) are those of the data on them.
        """
        sign = -1.0 if enters else 1.0
        for i, family in enumerate(self.families):
            shared = family.shared(self.space, directions)
            self.a[i] = self.a[i] + sign * shared @ shared.transpose(0, 2, 1)
            self.b[i] = self.b[i] + sign * shared @ coefficients
        self.rss += sign * float(coefficients @ coefficients)
        self.freedom += int(sign) * len(coefficients)

    def gains(self, index: int) -> tuple[Array, Array]:
        """Compute gain and number of columns that count of one family, both (places,).

        They are zero if physics forbids the estimate.
        """
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

    def multiplicity(self, index: int, place: int) -> float:
        """Return the number of tries for which a place counts.

        It is the number of families, multiplied by the number of equally likely places of its scan. If
        effects were found in robots of the type, half of the tries is theirs (`calib.model.model`).
        """
        alike = len(self.families) * self.families[index].alike(place)
        if not self.shares:
            return alike
        return 1.0 / (0.5 / alike + self.shares.get((index, place), 0.0))

    def multiplicity_of(self, effect: Effect) -> float:
        """Return the number of tries for which an effect of the model counts."""
        for index, family in enumerate(self.families):
            if effect.label == family.label or effect.label.startswith(family.label + ":"):
                return self.multiplicity(index, family.place_of(effect))
        return len(self.families)

    def best_of(self, index: int) -> Score:
        """Find the best place of one family."""
        gain, freedom = self.gains(index)
        place = self.families[index].choose(gain, self)
        return self.at(index, place, float(gain[place]), int(freedom[place]))

    def at(self, index: int, place: int, gain: float, freedom: int) -> Score:
        """Score one place of one family."""
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
    """Return the expected sizes of an effect's parameters, shape (p,), internal units.

    Those without one count as 1 of their unit.
    """
    return np.array([to_internal(1.0 if p.size is None else p.size, p.unit) for p in effect.parameters])


def gain_of(a: Array, b: Array, raw: Array, absorbed: float = ABSORBED) -> tuple[Array, Array]:
    """b'A^-1 b for a stack (c, p, p), (c, p); columns are scaled by their raw squares (c, p).

    Directions of which less than the share `absorbed` is left after projection do not count: the model absorbs them.
    Returns gains (c,) and the number of directions that count (c,).
    """
    scale = 1.0 / np.sqrt(np.maximum(raw, 1e-300))
    a, b = a * scale[:, :, None] * scale[:, None, :], b * scale
    if a.shape[1] == 2:
        return _gain_of_two(a, b, absorbed)
    values, vectors = np.linalg.eigh(a)
    along = np.einsum("cij,ci->cj", vectors, b)
    counts = values > absorbed
    return np.sum(np.where(counts, along**2 / np.where(counts, values, 1.0), 0.0), axis=1), counts.sum(axis=1)


def estimate_of(a: Array, b: Array, raw: Array) -> tuple[Array, Array]:
    """Compute A^-1 b (c, p) and its variance for unit noise (c, p).

    Only the directions that `gain_of` counts are included, otherwise both are 0.
    """
    scale = 1.0 / np.sqrt(np.maximum(raw, 1e-300))
    values, vectors = np.linalg.eigh(a * scale[:, :, None] * scale[:, None, :])
    inverse = np.where(values > ABSORBED, 1.0 / np.maximum(values, ABSORBED), 0.0)
    along = np.einsum("cij,ci->cj", vectors, b * scale)
    estimate = np.einsum("cij,cj->ci", vectors, inverse * along)
    return estimate * scale, np.einsum("cij,cj->ci", vectors**2, inverse) * scale**2


def _gain_of_two(a: Array, b: Array, absorbed: float) -> tuple[Array, Array]:
    """Do the same for two columns, written out: harmonics are by far the most numerous."""
    middle, half = 0.5 * (a[:, 0, 0] + a[:, 1, 1]), 0.5 * (a[:, 0, 0] - a[:, 1, 1])
    radius = np.hypot(half, a[:, 0, 1])
    angle = 0.5 * np.arctan2(a[:, 0, 1], half)
    c, s = np.cos(angle), np.sin(angle)
    values = np.stack([middle + radius, middle - radius])
    along = np.stack([c * b[:, 0] + s * b[:, 1], c * b[:, 1] - s * b[:, 0]])
    counts = values > absorbed
    return np.sum(np.where(counts, along**2 / np.where(counts, values, 1.0), 0.0), axis=0), counts.sum(axis=0)
