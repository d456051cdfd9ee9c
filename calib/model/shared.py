"""The error that the readings of a visit share: the deviation of the robot's rest position.

With A the derivative of the readings of a visit by the joints, times the repeatability and whitened by the
instrument's noise, their covariance is I + A A'. Its inverse root

    (I + A A')^-1/2 = I - (A V) diag h (A V)',    A'A = V diag l V',    h = (1 - (1 + l)^-1/2) / l,

makes rows of variance 1 of them, and of all such matrices changes each row least (Kessy et al. 2018, ZCA). Only
matrices of joints by joints are factored, whatever the number of readings; those of all visits at once.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from calib.array import Array


@dataclass(frozen=True)
class Shared:
    """Visits of n readings of k rows: visit (n,); A as scatter (N, k, n), one matrix a joint, 0: none shared."""

    visit: NDArray[np.int64]
    scatter: Array

    def take(self, keep: NDArray[np.bool_] | NDArray[np.int64]) -> Shared:
        """Some of the readings, by mask or index."""
        return Shared(self.visit[keep], np.ascontiguousarray(self.scatter[:, :, keep]))

    @cached_property
    def alone(self) -> Array:
        """(k, k, n) lower-triangular whitener of a reading by itself, without the others of its visit."""
        own = np.einsum("aki,ali->ikl", self.scatter, self.scatter) + np.eye(self.scatter.shape[1])
        return np.ascontiguousarray(np.linalg.inv(np.linalg.cholesky(own)).transpose(1, 2, 0))

    @cached_property
    def _of_visits(self) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64], Array]:
        """The readings that share (s,), visit after visit; where each visit begins (v,); the place of each reading's
        visit among them (s,); A V sqrt(h), (N, k, s)."""
        some = np.flatnonzero(np.any(self.scatter != 0.0, axis=(0, 1)))
        some = some[np.argsort(self.visit[some], kind="stable")]
        _, first, place = np.unique(self.visit[some], return_index=True, return_inverse=True)
        a = self.scatter[:, :, some]
        gram = np.add.reduceat(np.einsum("aki,bki->iab", a, a), first, axis=0)
        square, axes = np.linalg.eigh(gram)
        grown = np.sqrt(1.0 + np.maximum(square, 0.0))
        h = 1.0 / (grown * (grown + 1.0))
        return some, first, place, np.einsum("aki,iab->bki", a, (axes * np.sqrt(h)[:, None])[place])

    def whitened(self, rows: Array) -> Array:
        """Rows (..., k, n), whitened reading by reading, now visit by visit."""
        some, first, place, directions = self._of_visits
        if not len(some):
            return rows
        out = rows.copy()
        own = rows[..., some]
        left = own.copy()
        for direction in directions:
            of_visit = np.add.reduceat(np.sum(direction * own, axis=-2), first, axis=-1)
            left -= direction * of_visit[..., None, place]
        out[..., some] = left
        return out
