"""Mean and spread of parameters over robots whose values have different uncertainties.

    x_i ~ N(mu, T),  T = diag(t),        information from robot i on x_i: precision L_i, right side L_i y_i

L_i may be singular: parameters that a robot's readings do not determine carry no information on the type. k_ij is 1 if
parameter j of robot i belongs to the type, and 0 if not. With Q_i = diag(k_ij / t_j) and V_i = (L_i + Q_i)^-1, the
precision of y_i about mu is

    W_i = Q_i - Q_i V_i Q_i,      W_i y_i = Q_i V_i L_i y_i,      mu = C sum_i W_i y_i,  C = (sum_i W_i)^-1.

t is that of restricted maximum likelihood, by steps that stay positive and increase the likelihood:

    t_j <- t_j sqrt( sum_i g_ij^2 / sum_i (W_i - W_i C W_i)_jj ),      g_i = W_i (y_i - mu),

and its covariance is the inverse of Fisher's information. For one parameter this is the random-effects model of
DerSimonian and Laird.

Parameter j of a robot is outside the type according to z_ij = g_ij / sqrt((W_i - W_i C W_i)_jj), which is standard
normal for a member. This tests a shift of that parameter alone. The limits are those of Student's t, since the spread
is estimated from a limited number of robots. A value that took part has itself widened the spread.

Sources: Patterson and Thompson 1971 (REML), Zhou, Hu, Zhou and Lange 2019 (the steps), DerSimonian and Laird 1986,
Viechtbauer and Cheung 2010 (outliers among studies), Cook and Weisberg 1982 (values with and without themselves).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.special import stdtrit

from calib.array import Array

_ROUNDS = 400
_SETTLED = 1e-3  # step of a variance, in its standard errors, at which it has arrived
_LEAST = 1e-6  # share of the usual size below which a spread counts as zero
_CHANCE = 0.01  # probability that any parameter of any robot of the type is called an outlier
_APART, _FEW = (
    4.0,
    10.0,
)  # robust standard deviations, times 1 + few / N, beyond which a value stays out at first
_SWAPS = 20


@dataclass(frozen=True)
class TypeModel:
    """Mean and spread of p parameters over N robots, in the units of the input.

    Attributes
    ----------
    mean, mean_std, spread : array of shape (p,)
        Mean, its standard error, and spread.
    spread_std : array of shape (p,)
        Increase of the spread if its square increases by one standard error.
    z : array of shape (N, p)
        Test of every value.
    member : array of bool, shape (N, p)
        Values that took part.
    """

    mean: Array
    mean_std: Array
    spread: Array
    spread_std: Array
    z: Array
    member: NDArray[np.bool_]

    @property
    def of_next(self) -> Array:
        """Standard deviation of a further robot about the mean, shape (p,).

        It combines the spread, increased by one standard error, with the uncertainty of the mean.
        """
        return np.sqrt((self.spread + self.spread_std) ** 2 + self.mean_std**2)


def hierarchy(precision: Array, right: Array, usual: Array) -> TypeModel:
    """Estimate mean and spread of parameters over robots.

    Values outside the type are left out, and tested again.

    Parameters
    ----------
    precision, right : array of shape (N, p, p) and (N, p)
        Precision and right side of each robot.
    usual : array of shape (p,)
        Usual sizes of the parameters, used only for scaling.
    """
    precision = precision * usual[:, None] * usual
    right = right * usual
    member = _first(precision, right)
    told = _told(precision)
    own = np.maximum(told.sum(axis=0) - 1, 2)
    without = -stdtrit(own, 0.5 * _CHANCE / max(int(told.sum()), 1))  # limit for a value that took no part
    # Limit for a value that widened the spread itself
    within = without * np.sqrt(own / (own - 1 + without**2))
    variance = np.full(len(usual), 0.1)
    state = _State.of(precision, right, variance, member)
    for _ in range(_SWAPS):
        state = _settled(precision, right, state.variance, member)
        z = state.tests(precision, right)
        away = np.where(member, np.abs(z), 0.0) / within
        back = np.where(member, np.inf, np.abs(z)) / without
        if away.max() > 1.0:
            member = member.copy()
            member[np.unravel_index(np.argmax(away), away.shape)] = False
        elif back.min() < 1.0:
            member = member | (back < 1.0)
        else:
            break
    spread = np.sqrt(state.variance)
    above = np.sqrt(state.variance + state.variance_std) - spread
    mean_std = np.sqrt(np.diag(state.covariance))
    return TypeModel(
        state.mean * usual,
        mean_std * usual,
        spread * usual,
        above * usual,
        state.tests(precision, right),
        member,
    )


@dataclass(frozen=True)
class _State:
    """State of the fit at variances (p,) and members (N, p).

    It contains the weights W (N, p, p), W y (N, p), and the mean (p,) with its covariance (p, p).
    """

    weights: Array
    pulled: Array
    mean: Array
    covariance: Array
    variance: Array
    member: NDArray[np.bool_]

    @classmethod
    def of(cls, precision: Array, right: Array, variance: Array, member: NDArray[np.bool_]) -> _State:
        weights, pulled = _weights(precision, right, variance, member)
        covariance = np.linalg.inv(weights.sum(axis=0))
        return cls(weights, pulled, covariance @ pulled.sum(axis=0), covariance, variance, member)

    @property
    def gradient(self) -> Array:
        """Pull g of every robot on the mean, shape (N, p)."""
        return self.pulled - self.weights @ self.mean

    @property
    def freedom(self) -> Array:
        """Diagonal of W - W C W, shape (N, p)."""
        return np.einsum("ijj->ij", self.weights - self.weights @ self.covariance @ self.weights)

    @property
    def variance_std(self) -> Array:
        """Standard errors of the variances, shape (p,)."""
        w, c = self.weights, self.covariance
        with_mean = np.einsum("ijk,ijk->jk", w, w @ c @ w)
        of_columns = np.einsum("iaj,ibj->jab", w, w)
        twice = np.einsum("jab,kba->jk", c @ of_columns, c @ of_columns)
        information = 0.5 * np.sum(w**2, axis=0) - with_mean + 0.5 * twice
        scale = 1.0 / np.sqrt(np.maximum(np.diag(information), 1e-300))
        inverse = np.linalg.pinv(information * scale * scale[:, None], hermitian=True)
        return np.sqrt(np.maximum(np.diag(inverse), 0.0)) * scale

    def tests(self, precision: Array, right: Array) -> Array:
        """Compute z of every value, shape (N, p), including values that took no part.

        It is zero if the readings of a robot do not determine the parameter.
        """
        whole, pulled = _weights(precision, right, self.variance, np.ones_like(self.member))
        off = pulled - whole @ self.mean
        with_mean = np.einsum("ijj->ij", whole @ self.covariance @ whole)
        own = np.einsum("ijj->ij", whole)
        variance = np.where(self.member, own - with_mean, own + with_mean)
        told = _told(precision) & (variance > 1e-9 * np.maximum(own, 1e-300))
        return np.where(told, off / np.sqrt(np.where(told, variance, 1.0)), 0.0)


def _weights(
    precision: Array, right: Array, variance: Array, member: NDArray[np.bool_]
) -> tuple[Array, Array]:
    """Compute W (N, p, p) and W y (N, p)."""
    q = member / variance
    inverse = _inverse(precision + q[:, :, None] * np.eye(len(variance)))
    weights = -q[:, :, None] * inverse * q[:, None, :]
    weights[:, range(len(variance)), range(len(variance))] += q
    return weights, q * (inverse @ right[:, :, None])[:, :, 0]


def _inverse(matrices: Array) -> Array:
    """Invert positive matrices (N, p, p), scaled internally to unit diagonals.

    Undetermined parameters are left out.
    """
    diagonal = np.einsum("ijj->ij", matrices)
    scale = 1.0 / np.sqrt(np.where(diagonal > 0.0, diagonal, 1.0))
    scaled = matrices * scale[:, :, None] * scale[:, None, :]
    rows, places = np.nonzero(diagonal <= 0.0)
    scaled[rows, places, places] = 1.0
    inverse = np.linalg.inv(scaled) * scale[:, :, None] * scale[:, None, :]
    inverse[rows, places, :] = 0.0
    inverse[rows, :, places] = 0.0
    return inverse


def _settled(precision: Array, right: Array, variance: Array, member: NDArray[np.bool_]) -> _State:
    """Find the variances of restricted maximum likelihood."""
    state = _State.of(precision, right, variance, member)
    for step in range(_ROUNDS):
        ratio = np.sum(state.gradient**2, axis=0) / np.maximum(state.freedom.sum(axis=0), 1e-300)
        better = np.maximum(state.variance * np.sqrt(ratio), _LEAST**2)
        moved = np.abs(better - state.variance)
        arrived = step % 10 == 9 and np.all(moved <= _SETTLED * state.variance_std)
        state = _State.of(precision, right, better, member)
        if arrived:
            break
    return state


def _told(precision: Array) -> NDArray[np.bool_]:
    """Mark the parameters on which the readings of each robot give information, shape (N, p)."""
    return np.einsum("ijj->ij", precision) > 0.0


def _first(precision: Array, right: Array) -> NDArray[np.bool_]:
    """Select initial members (N, p): values near the median of their parameter.

    The values are those of the readings alone. The limits use spreads that a few outliers do not widen.
    """
    told = _told(precision)
    eye = np.eye(precision.shape[1])
    covariance = _inverse(precision + 1e-9 * eye * np.einsum("ijj->ij", precision)[:, :, None])
    value = np.where(told, (covariance @ right[:, :, None])[:, :, 0], np.nan)
    member = np.ones(told.shape, dtype=bool)
    for j in np.flatnonzero(told.sum(axis=0) > 2):
        of = told[:, j]
        off = np.abs(value[of, j] - np.median(value[of, j]))
        own = np.sqrt(covariance[of, j, j])
        apart = _APART * (1.0 + _FEW / int(of.sum()))
        member[of, j] = off <= apart * np.maximum(1.4826 * np.median(off), own)
    return member
