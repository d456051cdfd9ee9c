"""Observability indices O1 to O5 of a Jacobian: how well poses determine parameters, in one number each.

With the singular values s_1 >= ... >= s_m of the Jacobian of n poses: O1 = (s_1 ... s_m)^(1/m) / sqrt(n),
O2 = s_m / s_1, O3 = s_m, O4 = s_m^2 / s_1, O5 = 1 / sum(1 / s_i). O1 ranks selections the same in any units of the
parameters; O2 to O5 do not, so their columns must be scaled.
Sources: Borm and Menq 1991 (O1), Driels and Pathre 1990 (O2), Nahvi et al. 1994 (O3), Nahvi and Hollerbach 1996
(O4), Sun and Hollerbach 2008 (O5); Nubiola 2.5.2.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.errors import DataError


@dataclass(frozen=True)
class Observability:
    """The five indices; larger is better in all."""

    o1: float
    o2: float
    o3: float
    o4: float
    o5: float


def observability(jacobian: Array, poses: int) -> Observability:
    """Indices of a Jacobian (rows, m) of so many poses; 0 throughout where it does not determine m parameters.

    Raises DataError when it has fewer rows than columns, or a number that is not finite.
    """
    rows, m = jacobian.shape
    if rows < m or m == 0:
        raise DataError(f"the Jacobian has {rows} rows for {m} parameters.", do="Give at least as many rows.")
    if not np.all(np.isfinite(jacobian)):
        raise DataError("the Jacobian has a number that is not finite.", do="Leave that pose out.")
    s = np.linalg.svd(jacobian, compute_uv=False)
    if s[-1] <= np.finfo(np.float64).eps * rows * s[0]:
        return Observability(0.0, 0.0, 0.0, 0.0, 0.0)
    return Observability(
        o1=float(np.exp(np.mean(np.log(s))) / np.sqrt(poses)),
        o2=float(s[-1] / s[0]),
        o3=float(s[-1]),
        o4=float(s[-1] ** 2 / s[0]),
        o5=float(1.0 / np.sum(1.0 / s)),
    )
