"""The result of an identification. It is immutable; report, prediction and export are functions of it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.header import Header
from calib.fit.ending import Ending
from calib.fit.least_squares import Dropped
from calib.fit.of_type import Beside, Weighed, weighed
from calib.fit.readings import Readings, linearised
from calib.fit.uncertainty import predict_with_covariance
from calib.model.model import Design, RobotModel
from calib.model.ties import ties


@dataclass(frozen=True)
class Identification:
    """The result of an identification.

    estimate (m,) and covariance (m, m) in internal units, the covariance for the noise that was found (declared
    noise x noise_scale, where that is above 1); `readings` are those that took part.
    """

    model: RobotModel
    estimate: Array
    covariance: Array
    dropped: tuple[Dropped, ...]
    readings: Readings
    residual: Array  # (k, n) whitened with the declared noise
    prior: Array  # (m,) weight of the prior of every parameter, in whitened units
    noise_scale: float
    degrees_of_freedom: int
    faulty_rows: tuple[str, ...]
    relabelled_rows: tuple[tuple[str, str, str], ...]
    iterations: int
    ending: Ending
    warnings: tuple[str, ...]
    header: Header
    data_sha256: str
    beside: Beside | None = None  # the type of the robot, where the fit knew it

    @property
    def converged(self) -> bool:
        """Whether the iteration converged; else the parameters must not be used."""
        return self.ending is Ending.CONVERGED

    @property
    def standard_errors(self) -> Array:
        """(m,) internal units; 0 for a dropped parameter."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def held_std(self) -> Array:
        """(m,) standard deviation that the prior of every parameter had in this fit, internal units; inf without."""
        with np.errstate(divide="ignore"):
            return max(self.noise_scale, 1.0) / self.prior

    @property
    def weighed(self) -> tuple[Weighed, ...]:
        """The weight of prior and readings in each parameter that robots of the type share."""
        return weighed(self.model, self.estimate, self.covariance, 1.0 / self.held_std)

    @property
    def correlations(self) -> Array:
        """(m, m); NaN in the rows and columns of dropped parameters."""
        errors = np.where(self.standard_errors > 0.0, self.standard_errors, np.nan)
        return self.covariance / np.outer(errors, errors)

    @property
    def reduced_chi_square(self) -> float:
        """Sum of squares of the whitened residual over the degrees of freedom: 1 where the noise is as declared."""
        return self.noise_scale**2

    @property
    def _declared(self) -> Array:
        """(m, m) covariance for noise as declared."""
        return self.covariance / max(self.noise_scale, 1.0) ** 2

    @cached_property
    def _columns(self) -> tuple[Array, Array]:
        """The whitened Jacobian at the estimate: (m,) squared lengths of columns, (n,) leverage of readings."""
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
        """(n,) sum of the hat values of a reading's rows; those of all readings add up to the parameters fitted."""
        return self._columns[1]

    @cached_property
    def config_sha256(self) -> str:
        """Hash of the data and of what was asked of it: the model's parameters with their priors."""
        asked = [
            [e.label, p.name, p.unit, p.size, *([] if p.centre is None else [p.centre])]
            for e in self.model.effects
            for p in e.parameters
        ]
        return hashlib.sha256((self.data_sha256 + json.dumps(asked)).encode()).hexdigest()

    def predict(self, conditions: Conditions) -> Array:
        """(n, 3) points as the instrument would read them, mm."""
        return Design(self.model, conditions).predict(self.estimate)

    def predict_with_covariance(self, conditions: Conditions) -> tuple[Array, Array]:
        """Points (n, 3), mm, and the covariance (n, 3, 3), mm2, that the parameters' uncertainty gives them."""
        return predict_with_covariance(self.model, self.estimate, self.covariance, conditions)
