"""Evidence for causes of change in whitened residuals, for any number of watches at once.

Residuals r of an unchanged robot are white: N(0, I) over q rows. A cause with p parameters of usual sizes S has the
columns A (q, p), A S = U s V'. With the prior N(0, S^2) for its parameters

    gain      = |U' r|^2,                                        chi-squared with rank(U) if nothing has changed
    evidence  = 1/2 sum s^2 / (1 + s^2) (u.r)^2 - 1/2 sum log(1 + s^2)     log of the Bayes factor against no change
    estimate  = S V s / (1 + s^2) U' r

Directions that move no reading by a hundredth of its noise at the usual size are left out. For example, one target does
not show how a tool has turned about it.

The alarm uses the smallest p-value: that of all rows together (T-squared), or of any cause. Its limit is the quantile
of draws without any change at the stated rate, so that many tests do not raise more false alarms.

Sources: Kass and Raftery 1995 for the evidence. Hotelling's T-squared with a known covariance for the alarm.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy import stats
from scipy.special import gammaincc

from calib.array import Array
from calib.model.effect import Effect
from calib.units import to_internal

CERTAIN = 0.95  # share of the weight of a class from which one cause is identified
CLASS_WIDTH = 6.0  # difference of twice the evidence within which a cause belongs to the class of the best
_SHOWN = 1e-2  # whitened length of a direction at its usual size
_TWIN = 1e-4  # share of a cause that an alias may fail to reproduce
_DRAWS = 20_000


@dataclass(frozen=True)
class CauseColumns:
    """Cause in the rows of the readings, as a singular value decomposition.

    Attributes
    ----------
    directions, strengths, back : array of shape (q, r), (r,) and (p, r)
        U, s and S V, the latter in internal units.
    low, high : float
        Bounds of a lone parameter, internal units; infinite for several.
    plain : CauseColumns or None
        For a cause that shifts and turns, the cause that only shifts.
    """

    effect: Effect
    directions: Array
    strengths: Array
    back: Array
    low: float
    high: float
    plain: CauseColumns | None = None

    @classmethod
    def of(cls, effect: Effect, columns: Array) -> CauseColumns:
        """Build a cause from its whitened columns (q, p), internal units."""
        size = np.array([to_internal(p.size or 1.0, p.unit) for p in effect.parameters])
        u, s, vt = np.linalg.svd(columns * size, full_matrices=False)
        shown = s > _SHOWN
        low, high = effect.parameters[0].bounds if len(effect.parameters) == 1 else (-np.inf, np.inf)
        shifts = [k for k, p in enumerate(effect.parameters) if p.unit == effect.parameters[0].unit]
        plain = None
        if len(shifts) < len(effect.parameters):
            of_shifts = replace(effect, parameters=tuple(effect.parameters[k] for k in shifts))
            plain = cls.of(of_shifts, columns[:, shifts])
        return cls(effect, u[:, shown], s[shown], size[:, None] * vt[shown].T, low, high, plain)

    @property
    def freedom(self) -> int:
        """Number of directions that the readings show."""
        return len(self.strengths)

    @property
    def shrink(self) -> Array:
        """Share of each direction that the prior leaves, shape (r,)."""
        return self.strengths**2 / (1.0 + self.strengths**2)

    @property
    def covariance(self) -> Array:
        """Covariance of the estimate in the directions that the readings show, shape (p, p)."""
        return (self.back / (1.0 + self.strengths**2)) @ self.back.T

    def estimate(self, residual: Array) -> Array:
        """Estimate the parameters (d, p) from residuals (d, q)."""
        along = residual @ self.directions
        return (along * self.strengths / (1.0 + self.strengths**2)) @ self.back.T

    def gain(self, residual: Array) -> Array:
        """Compute the gain (d,) of residuals (d, q)."""
        return np.sum((residual @ self.directions) ** 2, axis=1)

    def evidence(self, residual: Array) -> Array:
        """Compute the evidence (d,) of residuals (d, q).

        A cause with shifts and turns and the same cause with shifts alone are equally likely a priori. The evidence is
        minus infinity if the estimate is outside the physical bounds by more than two standard errors.
        """
        whole = self.whole(residual)
        return (
            whole if self.plain is None else np.logaddexp(whole, self.plain.evidence(residual)) - np.log(2.0)
        )

    def whole(self, residual: Array) -> Array:
        """Compute the evidence (d,) with all parameters."""
        along = residual @ self.directions
        found = 0.5 * (along**2) @ self.shrink - 0.5 * np.sum(np.log1p(self.strengths**2))
        if self.freedom == 1 and (np.isfinite(self.low) or np.isfinite(self.high)):
            value, spread = self.estimate(residual)[:, 0], 2.0 * float(np.sqrt(self.covariance[0, 0]))
            found = np.where((value < self.low - spread) | (value > self.high + spread), -np.inf, found)
        return found

    def does(self, residual: Array) -> Array:
        """Compute the part (d, q) of residuals (d, q) that the estimate explains."""
        return ((residual @ self.directions) * self.shrink) @ self.directions.T


@dataclass(frozen=True)
class CauseAssignment:
    """Causes assigned to d watches.

    Attributes
    ----------
    best : array of int, shape (d,)
        Index of the likeliest cause.
    weights : array of shape (d, c)
        Weight of each cause, zero outside the class.
    """

    best: NDArray[np.int64]
    weights: Array

    @property
    def alone(self) -> NDArray[np.bool_]:
        """Whether one cause has nearly all of the weight, shape (d,)."""
        return np.max(self.weights, axis=1) >= CERTAIN

    @property
    def members(self) -> NDArray[np.bool_]:
        """Members of each class, that is, causes with some weight, shape (d, c)."""
        return self.weights > 0.0


@dataclass(frozen=True)
class Odds:
    """Causes that some readings of q rows can show."""

    causes: tuple[CauseColumns, ...]
    rows: int

    @classmethod
    def of(cls, effects: Sequence[Effect], columns: Sequence[Array]) -> Odds:
        """Build the odds from effects and their whitened columns (q, p each).

        Effects that no reading shows are left out.
        """
        every = [CauseColumns.of(e, c) for e, c in zip(effects, columns, strict=True)]
        return cls(tuple(c for c in every if c.freedom), columns[0].shape[0])

    def p_values(self, residual: Array) -> Array:
        """Compute the p-values (d, 1 + c) of residuals (d, q) under no change.

        The first column is for all rows together, the others are for one cause each.
        """
        every = _beyond(np.sum(residual**2, axis=1), self.rows)
        each = [_beyond(cause.gain(residual), cause.freedom) for cause in self.causes]
        return np.column_stack([every, *each])

    @cached_property
    def _by_chance(self) -> tuple[Array, list[int]]:
        """Sums of squares (d, 1 + c) of draws without change, and the degrees of freedom of each.

        The draws are the same in every run.
        """
        white = np.random.default_rng(20).normal(size=(_DRAWS, self.rows))
        each = [cause.gain(white) for cause in self.causes]
        return np.column_stack([np.sum(white**2, axis=1), *each]), [
            self.rows,
            *(c.freedom for c in self.causes),
        ]

    def limit(self, rate: float) -> float:
        """Find the p-value below which an alarm is raised at this false-alarm rate, within 1 %."""
        squares, freedom = self._by_chance
        low, high = (
            np.log(rate / len(freedom)) - 0.1,
            np.log(rate),
        )  # lower end by Bonferroni, upper end for a single test
        while high - low > 0.01:
            middle = 0.5 * (low + high)
            beyond = squares > stats.chi2.isf(np.exp(middle), freedom)
            low, high = (low, middle) if np.mean(np.any(beyond, axis=1)) > rate else (middle, high)
        return float(np.exp(low))

    def named(self, residual: Array) -> CauseAssignment:
        """Assign causes to residuals (d, q), assuming that something has changed."""
        gain = np.column_stack([cause.gain(residual) for cause in self.causes])
        return self.by(residual, self.evidence(residual), gain)

    def evidence(self, residual: Array) -> Array:
        """Compute the evidence (d, c) of every cause in residuals (d, q)."""
        return np.column_stack([cause.evidence(residual) for cause in self.causes])

    def by(self, residual: Array, evidence: Array, gain: Array) -> CauseAssignment:
        """Assign causes to residuals (d, q) from evidence and gain, both of shape (d, c).

        Both may come from the linear model or from fits through the whole chain.
        """
        freedom = np.array([cause.freedom for cause in self.causes])
        best = np.argmax(evidence, axis=1)
        cost = np.minimum(2.0 * (evidence.max(axis=1)[:, None] - evidence), 1e6)
        for b in np.unique(best):
            mine = best == b
            fit = np.maximum(gain[mine, b][:, None] - gain[mine], 0.0)
            # no more complex, or an alias: the usual size must not decide alone, only the fit
            alike = (freedom <= freedom[b]) | self._twins(int(b), residual[mine])
            possible = np.isfinite(evidence[mine])
            cost[mine] = np.where(alike & possible, np.minimum(cost[mine], fit), cost[mine])
        weights = np.where(cost < CLASS_WIDTH, np.exp(-0.5 * cost), 0.0)
        return CauseAssignment(best, weights / weights.sum(axis=1)[:, None])

    def _twins(self, best: int, residual: Array) -> NDArray[np.bool_]:
        """Find the causes (d, c) that explain all that the best one explains in these watches."""
        does = self.causes[best].does(residual)
        size = np.maximum(np.sum(does**2, axis=1), 1e-300)
        held = [np.sum((does @ cause.directions) ** 2, axis=1) / size for cause in self.causes]
        return np.column_stack(held) > 1.0 - _TWIN

    def always(self, cause: int) -> list[int]:
        """List the causes that can imitate this one at any size, so that it is never distinguished."""
        own = self.causes[cause].directions
        out = []
        for d, other in enumerate(self.causes):
            left = own - other.directions @ (other.directions.T @ own)
            if d != cause and np.all(np.sum(left**2, axis=0) < _TWIN):
                out.append(d)
        return out


def _beyond(squares: Array, freedom: int) -> Array:
    """Compute the probability (d,) that chi-squared exceeds given sums of squares (d,)."""
    return np.asarray(gammaincc(0.5 * freedom, 0.5 * squares), dtype=np.float64)
