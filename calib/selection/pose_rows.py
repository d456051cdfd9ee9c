"""Whitened Jacobian rows of candidate poses, prepared for optimal designs.

A pose i of N with k rows X_i (k, m) adds X_i'X_i to the information matrix of m parameters. D-optimality does not
change under an invertible transformation of the parameters, nor when the rows of a pose are rotated. The columns are
therefore made orthonormal over all candidates, so that every information matrix is well scaled. The rows of each pose
are rotated to their principal directions, and directions that are zero at every pose are left out. For example, three
targets on a rigid tool have nine rows, of which six count.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import solve_triangular

from calib.array import Array
from calib.errors import DataError
from calib.fit.least_squares import triangular_factor

_NOTHING = 1e-9  # singular value of a row, or of a column over all candidates, relative to the largest


@dataclass(frozen=True)
class PoseRows:
    """Prepared rows of all candidates.

    Attributes
    ----------
    columns : array of shape (m, k, N)
        Rows of all candidates, poses last, orthonormal over all candidates.
    log_scale : float
        Log det of the information of all candidates in the units of the original rows.
    """

    columns: Array
    log_scale: float

    @classmethod
    def of(cls, rows: Array) -> PoseRows:
        """Prepare rows (N, k, m).

        Raises
        ------
        DataError
            The rows are not finite, or too few to determine m parameters.
        """
        rows = np.asarray(rows, dtype=np.float64)
        if rows.ndim != 3 or rows.size == 0:
            raise DataError(
                f"the rows have shape {rows.shape}.", do="Give (candidates, rows per pose, parameters)."
            )
        if not np.all(np.isfinite(rows)):
            bad = int(np.argmin(np.all(np.isfinite(rows), axis=(1, 2))))
            raise DataError(f"candidate {bad} has a row that is not finite.", do="Leave it out.")
        m = rows.shape[2]
        size = np.linalg.norm(rows, axis=(0, 1))
        size[size == 0.0] = 1.0
        scaled = (rows / size).reshape(-1, m)
        triangle = triangular_factor(scaled) if len(scaled) >= m else np.zeros((m, m))
        spectrum = np.linalg.svd(triangle, compute_uv=False)
        rank = int(np.sum(spectrum > _NOTHING * spectrum[0]))
        if rank < m:
            raise DataError(
                f"all candidates together determine {rank} of {m} parameters.",
                do="Leave dependent parameters out first, or give more candidates.",
            )
        orthonormal = np.linalg.solve(triangle.T, scaled.T).T.reshape(rows.shape)
        _, directions = np.linalg.eigh(orthonormal @ orthonormal.transpose(0, 2, 1))
        turned = directions.transpose(0, 2, 1) @ orthonormal
        longest = np.linalg.norm(turned, axis=2).max(axis=0)
        turned = turned[:, longest > _NOTHING * longest.max()]
        log_scale = 2.0 * float(np.sum(np.log(np.abs(np.diag(triangle)) * size)))
        return cls(np.ascontiguousarray(turned.transpose(2, 1, 0)), log_scale)

    @property
    def poses(self) -> int:
        """Number of candidates N."""
        return self.columns.shape[2]

    @property
    def width(self) -> int:
        """Number of rows of a pose that count, k."""
        return self.columns.shape[1]

    @property
    def parameters(self) -> int:
        """Number of parameters m."""
        return self.columns.shape[0]

    def take(self, poses: NDArray[np.int64] | NDArray[np.bool_]) -> PoseRows:
        """Select candidates by index or mask, in the same scale."""
        return PoseRows(np.ascontiguousarray(self.columns[:, :, poses]), self.log_scale)

    def information(self, poses: NDArray[np.int64] | None = None, *, weights: Array | None = None) -> Array:
        """Compute the sum of X'X over candidates, shape (m, m).

        The default is all candidates (`poses`), with a weight of one each (`weights`).
        """
        x = self.columns if poses is None else self.columns[:, :, poses]
        weighted = x if weights is None else x * weights
        return weighted.reshape(self.parameters, -1) @ x.reshape(self.parameters, -1).T

    def sensitivity(self, information: Array) -> Array:
        """Compute tr(M^-1 X'X) of every candidate, shape (N,).

        Raises
        ------
        numpy.linalg.LinAlgError
            The information matrix is singular.
        """
        root = solve_triangular(
            np.linalg.cholesky(information), self.columns.reshape(self.parameters, -1), lower=True
        )
        return np.sum(root**2, axis=0).reshape(self.width, self.poses).sum(axis=0)
