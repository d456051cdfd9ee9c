"""The region in which a regression may be used: between the joint angles of its training, and nowhere else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.array import Array
from calib.units import DEG

MARGIN = 0.5 * DEG
"""By how much a joint may lie beyond the trained range: a wrist 5 deg away errs by millimetres."""
_FARTHER = 1.25  # than any training sample from their centre, in units of their spread


@dataclass(frozen=True)
class Region:
    """The trained ranges of the joints (N,), rad, and what the joints had in common.

    Angles that no training sample resembles may still lie within every joint's own range. `axes` (N, N) are the
    principal directions of the trained joint angles about `centre` (N,), and `spread` (N,) their standard deviations.
    Along a direction that hardly varied (a tool that always points down keeps q2 + q3 + q4) nothing may go farther than
    `reach` (N,); along the others together, nothing may lie outside the ellipsoid of `radius`.
    """

    lower: Array
    upper: Array
    centre: Array
    axes: Array
    spread: Array
    reach: Array
    radius: float

    @classmethod
    def of(cls, joints: Array) -> Region:
        """The region of training joints (n, N), rad."""
        centre = joints.mean(axis=0)
        values, axes = np.linalg.eigh((joints - centre).T @ (joints - centre) / len(joints))
        spread = np.maximum(np.sqrt(np.maximum(values, 0.0)), 1e-12)
        along = np.abs((joints - centre) @ axes)
        wide = spread > MARGIN
        radius = _FARTHER * float(np.linalg.norm(along[:, wide] / spread[wide], axis=1).max())
        reach = np.where(wide, np.inf, along.max(axis=0) + MARGIN)
        return cls(
            joints.min(axis=0) - MARGIN, joints.max(axis=0) + MARGIN, centre, axes, spread, reach, radius
        )

    def holds(self, joints: Array) -> NDArray[np.bool_]:
        """(k,) whether joints (k, N), rad, lie within; those that are NaN do not."""
        within = ((joints >= self.lower) & (joints <= self.upper)).all(axis=1)
        along = np.abs((joints - self.centre) @ self.axes)
        wide = np.isinf(self.reach)
        near = np.linalg.norm(along[:, wide] / self.spread[wide], axis=1) <= self.radius
        return within & near & (along <= self.reach).all(axis=1)
