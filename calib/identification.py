"""The result of an identification: immutable, and everything else (report, prediction, export) a function of it."""

from __future__ import annotations

import hashlib
import json
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from calib.conditions import Conditions
from calib.header import Header
from calib.kinematics import Array
from calib.least_squares import Dropped, jacobian
from calib.model import Design, RobotModel
from calib.readings import Readings
from calib.uncertainty import predict_with_covariance


@dataclass(frozen=True)
class Identification:
    """What was found.

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
    converged: bool
    warnings: tuple[str, ...]
    header: Header
    data_sha256: str

    @property
    def standard_errors(self) -> Array:
        """(m,) internal units; 0 for a dropped parameter."""
        return np.sqrt(np.diag(self.covariance))

    @property
    def correlations(self) -> Array:
        """(m, m); NaN in the rows and columns of dropped parameters."""
        errors = np.where(self.standard_errors > 0.0, self.standard_errors, np.nan)
        return self.covariance / np.outer(errors, errors)

    @property
    def reduced_chi_square(self) -> float:
        """Sum of squares of the whitened residual over the degrees of freedom: 1 where the noise is as declared."""
        return self.noise_scale**2

    @cached_property
    def _columns(self) -> Array:
        """(k n, m) whitened Jacobian at the estimate."""
        design = Design(self.model, self.readings.conditions)
        return jacobian(design, self.readings.observed, design.frames(self.estimate, design.slots))

    @cached_property
    def condition_number(self) -> float:
        """Of the Jacobian with its priors, columns scaled to length 1: by how much it may magnify an error."""
        active = self.standard_errors > 0.0
        stacked = np.vstack([self._columns[:, active], np.diag(self.prior[active])])
        return float(np.linalg.cond(stacked / np.linalg.norm(stacked, axis=0)))

    @cached_property
    def leverage(self) -> Array:
        """(n,) sum of the hat values of a reading's rows; those of all readings add up to the parameters fitted."""
        declared = self.covariance / max(self.noise_scale, 1.0) ** 2
        hat = np.einsum("ij,ij->i", self._columns @ declared, self._columns)
        return hat.reshape(self.residual.shape).sum(axis=0)

    @cached_property
    def config_sha256(self) -> str:
        """Hash of the data and of what was asked of it: the model's parameters with their priors."""
        asked = [[e.label, p.name, p.unit, p.size] for e in self.model.effects for p in e.parameters]
        return hashlib.sha256((self.data_sha256 + json.dumps(asked)).encode()).hexdigest()

    def predict(self, conditions: Conditions) -> Array:
        """(n, 3) points as the instrument would read them, mm."""
        return Design(self.model, conditions).predict(self.estimate)

    def predict_with_covariance(self, conditions: Conditions) -> tuple[Array, Array]:
        """Points (n, 3), mm, and the covariance (n, 3, 3), mm2, that the parameters' uncertainty gives them."""
        return predict_with_covariance(self.model, self.estimate, self.covariance, conditions)
