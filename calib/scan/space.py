"""The residuals of a fit, and the space that its model explains, beside which candidates are judged.

With J the whitened Jacobian of the fitted model (priors and distances between balls stacked below it), J = QR, a
candidate's columns X count only by P X, P = I - QQ': what the base model absorbs is no evidence. The residual r is
orthogonal to J already.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import solve_triangular

from calib.arm.kinematics import Frames
from calib.array import Array
from calib.fit.identification import Identification
from calib.fit.least_squares import jacobian, orthonormal
from calib.model.effect import Effect
from calib.model.model import Design
from calib.model.regressors import Regressor
from calib.model.ties import ties
from calib.scan.physics import bounds_of, impossible


@dataclass(frozen=True)
class Space:
    """The whitened rows of a fit: k rows a reading (k, n) flattened, `size` = k n, of which `rows` were measured."""

    fitted: Identification
    frames: Frames
    residual: Array  # (k, n)
    held: Array  # (size + a + q,): residuals of the readings, of the priors, of the distances between balls
    basis: Array  # (size + a + q, a): Q, over all of these
    covariance: Array  # (m, m) of the estimate for unit noise
    columns: Array  # (size, m)
    triangle: Array  # (a, a): R of the active columns of readings and priors, Q R

    @classmethod
    def of(cls, fitted: Identification) -> Space:
        """The space of a fit."""
        design = Design(fitted.model, fitted.readings.conditions)
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
        """(size, a): the part of Q that belongs to the readings."""
        return self.basis[: self.size]

    @property
    def freedom(self) -> int:
        """Degrees of freedom left."""
        return self.rows - self.basis.shape[1]

    def slot(self, slot: str) -> Array:
        """(k, n) whitened derivative of the readings for a unit of a slot, the same in all readings of a visit."""
        observed = self.fitted.readings.observed
        return observed.by_visit(observed.column(self.frames, slot))

    def effect_columns(self, effect: Effect) -> Array:
        """(size, p) whitened columns of an effect, whether the model has it or not."""
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
        """(size, c) for c vectors (size, c): what columns that are whitened reading by reading share with the result is
        what they, whitened by visit, share with the vectors."""
        observed = self.fitted.readings.observed
        if observed.shared is None:
            return rows
        return observed.by_visit(rows.T.reshape(-1, *self.residual.shape)).reshape(rows.shape[1], -1).T

    def by_reading(self, slot_columns: Array, rows: Array) -> Array:
        """(n, c): for c row vectors (size, c), the sum over a reading's k rows of slot column x vector."""
        k, n = slot_columns.shape
        return np.einsum("kn,knc->nc", slot_columns, rows.reshape(k, n, -1))

    def own_direction(self, effect: Effect) -> tuple[Array, Array]:
        """The space that one effect of the model alone explains: orthonormal (size, p) and the coefficients (p,) in it.

        The columns of the effect less what all others explain are X C_e (C = covariance, C_e its columns of the
        effect), with Gram matrix C_ee; so q = X C_e L^-T and q'r = L^-1 beta, C_ee = L L'.
        """
        positions = self.fitted.model.positions(effect)
        live = [i for i in positions if self.covariance[i, i] > 0.0]
        lower = np.linalg.cholesky(self.covariance[np.ix_(live, live)])
        direction = solve_triangular(lower, (self.columns @ self.covariance[:, live]).T, lower=True).T
        return direction, solve_triangular(lower, self.fitted.estimate[live], lower=True)

    def forbids(self, effect: Effect) -> bool:
        """Whether the estimate of an effect of the model lies beyond what physics allows by more than its noise."""
        bounds = bounds_of(effect)
        if bounds is None:
            return False
        at = self.fitted.model.positions(effect)
        noise = max(self.rss / max(self.freedom, 1), 1.0)
        errors = np.sqrt(np.diag(self.covariance)[at] * noise)
        return bool(impossible(bounds, self.fitted.estimate[at], errors))

    def own_coordinates(self, effect: Effect) -> tuple[Array, Array]:
        """`own_direction` in coordinates of the basis, readings and priors together: t (a, p) with q = Q t, c (p,)."""
        active = np.flatnonzero(np.diag(self.covariance) > 0.0)
        live = np.isin(active, self.fitted.model.positions(effect))
        within = self.covariance[np.ix_(active, active[live])]
        lower = np.linalg.cholesky(within[live])
        t = solve_triangular(lower, (self.triangle @ within).T, lower=True).T
        return t, solve_triangular(lower, self.fitted.estimate[active[live]], lower=True)
