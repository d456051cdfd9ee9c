"""Result of an identification, and the uncertainty of its predictions.

The result is immutable; report, prediction and export are functions of it.

The covariance of the parameters is propagated to the tool point, C_p = J C J'. It is small near the
readings and large where the model extrapolates: a joint that was never loaded, a corner that was never
measured. It contains the effect of parameters that the readings did not determine, but no error of the
model itself. Source: GUM, first-order propagation.

A carried term keeps its value beyond the measured range, where nothing confirms it. There its whole
prior size is added along the motion of its slot, in proportion up to a quarter of the width of the range
beyond it.
"""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.special import chdtri

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.header import Header
from calib.fit.ending import FitTermination
from calib.fit.least_squares import DroppedParameter
from calib.fit.readings import FitReadings, linearised
from calib.fit.type_prior import ParameterWeight, TypeFit, weighed
from calib.model.model import BoundModel, ModelStructure, ties

_AT_ONCE = 1200  # points whose columns are in memory at a time

_UNKNOWN_BEYOND = (
    0.25  # of the measured width: from there on nothing is known of a carried term but its prior size
)

_CONTAINED = 0.95
_NODES = 32
_FIRST_STEP, _SECANTS = 0.01, 3  # from then on the radius is as exact as the integral


@dataclass(frozen=True)
class IdentificationFit:
    """Result of an identification.

    Attributes
    ----------
    estimate : array of shape (m,)
        Parameter values, internal units.
    covariance : array of shape (m, m)
        Covariance of the estimate, internal units, scaled by `noise_scale**2` if that exceeds 1.
    readings : FitReadings
        Readings that took part in the fit.
    """

    model: ModelStructure
    estimate: Array
    covariance: Array
    dropped: tuple[DroppedParameter, ...]
    readings: FitReadings
    residual: Array  # (k, n) whitened with the declared noise
    prior: Array  # (m,) weight of the prior of every parameter, in whitened units
    noise_scale: float
    degrees_of_freedom: int
    faulty_rows: tuple[str, ...]
    relabelled_rows: tuple[tuple[str, str, str], ...]
    iterations: int
    ending: FitTermination
    warnings: tuple[str, ...]
    header: Header
    data_sha256: str
    beside: TypeFit | None = None  # the type of the robot, where the fit knew it

    @property
    def converged(self) -> bool:
        """Whether the iteration converged; if not, the parameters must not be used."""
        return self.ending is FitTermination.CONVERGED

    @property
    def standard_errors(self) -> Array:
        """Standard errors of the parameters, shape (m,), internal units; 0 if dropped."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def held_std(self) -> Array:
        """Standard deviations of the parameters' priors in this fit, shape (m,), internal units.

        They are infinite without a prior.
        """
        with np.errstate(divide="ignore"):
            return max(self.noise_scale, 1.0) / self.prior

    @property
    def weighed(self) -> tuple[ParameterWeight, ...]:
        """The weight of prior and readings in each parameter that robots of the type share."""
        return weighed(self.model, self.estimate, self.covariance, 1.0 / self.held_std)

    @property
    def correlations(self) -> Array:
        """Correlations of the parameters, shape (m, m); NaN for dropped parameters."""
        errors = np.where(self.standard_errors > 0.0, self.standard_errors, np.nan)
        return self.covariance / np.outer(errors, errors)

    @property
    def reduced_chi_square(self) -> float:
        """Sum of squares of the whitened residual per degree of freedom; 1 for noise as declared."""
        return self.noise_scale**2

    @property
    def _declared(self) -> Array:
        """Covariance for noise as declared, shape (m, m)."""
        return self.covariance / max(self.noise_scale, 1.0) ** 2

    @cached_property
    def _columns(self) -> tuple[Array, Array]:
        """Squared column lengths (m,) of the whitened Jacobian, and leverage (n,) of readings."""
        square, leverage = np.zeros(len(self.estimate)), np.zeros(len(self.readings.rows))
        for part, residual, columns in linearised(self.model, self.readings, self.estimate):
            square += np.sum(columns**2, axis=0)
            hat = np.einsum("ij,ij->i", columns @ self._declared, columns)
            leverage[part] = hat.reshape(residual.shape).sum(axis=0)
        return square, leverage

    @cached_property
    def condition_number(self) -> float:
        """The condition number of the Jacobian with its priors, columns scaled to length 1.

        Its squared singular values are the inverse of the eigenvalues of the covariance that is scaled likewise.
        """
        active = self.standard_errors > 0.0
        tied = max(self.noise_scale, 1.0) * ties(self.model, self.estimate)[1]
        size = np.sqrt(self._columns[0] + self.prior**2 + np.sum(tied**2, axis=0))[active]
        values = np.linalg.eigvalsh(self._declared[np.ix_(active, active)] * np.outer(size, size))
        return float(np.sqrt(values[-1] / values[0]))

    @property
    def leverage(self) -> Array:
        """Leverage of the readings, shape (n,): the sum of the hat values of a reading's rows.

        Those of all readings add up to the number of fitted parameters.
        """
        return self._columns[1]

    @cached_property
    def config_sha256(self) -> str:
        """Hash of the data and of the requested model: its parameters with their priors."""
        asked = [
            [e.label, p.name, p.unit, p.size, *([] if p.centre is None else [p.centre])]
            for e in self.model.effects
            for p in e.parameters
        ]
        return hashlib.sha256((self.data_sha256 + json.dumps(asked)).encode()).hexdigest()

    def predict(self, conditions: Conditions) -> Array:
        """Predict the points that the instrument would read, shape (n, 3), mm."""
        return BoundModel(self.model, conditions).predict(self.estimate)

    def predict_with_covariance(self, conditions: Conditions) -> tuple[Array, Array]:
        """Predict points (n, 3), mm, and their covariances (n, 3, 3), mm2.

        The covariances are those from the uncertainty of the parameters.
        """
        return predict_with_covariance(self.model, self.estimate, self.covariance, conditions)


def predict_with_covariance(
    model: ModelStructure, estimate: Array, covariance: Array, conditions: Conditions
) -> tuple[Array, Array]:
    """Predict points and their covariances from the covariance of the estimate.

    Parameters
    ----------
    model : ModelStructure
        Structure of the model.
    estimate, covariance : array of shape (m,), (m, m)
        Estimate and its covariance, internal units.
    conditions : Conditions
        Conditions of n readings.

    Returns
    -------
    points : array of shape (n, 3)
        Predicted points, mm.
    spread : array of shape (n, 3, 3)
        Their covariances, mm2.
    """
    n = len(conditions)
    points, spread = np.empty((n, 3)), np.empty((n, 3, 3))
    for part in np.array_split(np.arange(n), max(-(-n // _AT_ONCE), 1)):
        design = BoundModel(model, conditions.take(part))
        frames = design.frames(estimate, design.slots)
        columns = design.point_columns(frames).reshape(3, len(part), -1)
        points[part] = np.broadcast_to(frames.p, (3, len(part))).T
        spread[part] = np.einsum("anm,bnm->nab", columns @ covariance, columns, optimize=True)
        if beyond := _beyond(design):
            moves = frames.velocities(tuple(beyond))
            for move, variance in zip(moves, beyond.values(), strict=True):
                spread[part] += np.einsum("an,bn,n->nab", move, move, variance)
    return points, spread


def _beyond(design: BoundModel) -> dict[str, Array]:
    """Estimate the variance that carried terms add to each slot beyond the measured range.

    It has the shape (n,) per slot, in internal units. A term with the value 0 at the border may have any
    value beyond it, so each effect counts with its full amplitude.
    """
    model, found = design.model, dict[str, Array]()
    for effect in model.effects:
        distance = np.array([*effect.beyond(design.conditions).values()])
        if not distance.any():
            continue
        grown = np.minimum(distance.max(axis=0) / _UNKNOWN_BEYOND, 1.0) ** 2
        for slot in dict.fromkeys(term.slot for term in effect.terms):
            terms = [t for t in effect.terms if t.slot == slot]
            size = [(model.prior_std[model.index[t.parameter]] * t.weight) ** 2 for t in terms]
            values = [t.regressor.evaluate(design.conditions) ** 2 for t in terms]
            amplitude = sum(s * v for s, v in zip(size, values, strict=True))
            variance = grown * np.maximum(amplitude, np.mean(size))
            found[slot] = found.get(slot, 0.0) + variance
    return found


def expanded(covariance: Array) -> Array:
    """Compute the expanded uncertainty U (k = 2) along the worst direction, mm, shape (n,).

    `covariance` is (n, 3, 3). This sphere contains 74 to 95 % of the points; `radius_95` contains 95 %.
    """
    largest = np.linalg.eigvalsh(covariance)[:, -1]
    return 2.0 * np.sqrt(np.maximum(largest, 0.0))


def radius_95(covariance: Array) -> Array:
    """Compute the radius of the sphere that contains 95 % of the points, mm, shape (n,).

    `covariance` is (n, 3, 3); the radius is exact to one part in 1000. The distance along the worst axis
    is integrated over Gauss-Legendre nodes. The other two are integrated over all directions of their
    plane, because the remaining distribution is exponential in each. The radius follows by secants, from the
    chi-square distribution with the same mean, variance and skewness.
    """
    values = np.maximum(np.linalg.eigvalsh(covariance), 0.0)
    largest = values[:, 2]
    shares = values[:, :2] / np.where(largest > 0.0, largest, 1.0)[:, None]
    mean, variance, skewness = (1.0 + np.sum(shares**k, axis=1) for k in (1, 2, 3))
    freedom = variance**3 / skewness**2
    beyond = chdtri(freedom, 1.0 - _CONTAINED) - freedom
    near = np.sqrt(mean + beyond * np.sqrt(variance / freedom))  # in standard deviations, within 1 %
    radius, off = near + _FIRST_STEP, _contained(near, shares) - _CONTAINED
    for _ in range(_SECANTS):
        before, off = off, _contained(radius, shares) - _CONTAINED
        rise = np.where(off == before, 1.0, off - before)
        near, radius = radius, radius - off * (radius - near) / rise
    return radius * np.sqrt(largest)


_X, _WEIGHT = np.polynomial.legendre.leggauss(_NODES)
_TURNS = (np.arange(16) + 0.5) * np.pi / 32.0  # a quarter turn; the plane is symmetric


def _contained(radius: Array, shares: Array) -> Array:
    """Compute the share of points within a radius (n,), for variances `shares` (n, 2) and 1."""
    along = radius[:, None] * np.sin(
        0.5 * np.pi * _X
    )  # dense at the ends, where the plane shrinks to nothing
    step = radius[:, None] * np.cos(0.5 * np.pi * _X) * 0.5 * np.pi * _WEIGHT
    left = np.maximum(radius[:, None] ** 2 - along**2, 0.0)
    # in the whitened plane the square of the distance is exponential in every direction
    plane = np.maximum(shares[:, :1] * np.cos(_TURNS) ** 2 + shares[:, 1:] * np.sin(_TURNS) ** 2, 1e-12)
    within = -np.expm1(-0.5 * left[:, :, None] / plane[:, None, :]).mean(axis=2)
    return np.sum(step * np.exp(-0.5 * along**2) * within, axis=1) / np.sqrt(2.0 * np.pi)
