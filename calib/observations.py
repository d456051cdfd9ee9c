"""What was measured, as whitened rows: residuals, and their derivative for a unit of a slot.

An observation of kind k maps the chain's frame and twist to numbers and divides by its own noise; whitening
happens here and nowhere else. A tool point has three rows a reading.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.kinematics import Array, Frames


@dataclass(frozen=True)
class Points:
    """Measured tool points (n, 3), mm, with whiteners (3, 3, n)."""

    measured: Array
    whiten: Array

    @property
    def rows(self) -> int:
        """Number of whitened rows."""
        return self.measured.size

    def residual(self, frames: Frames) -> Array:
        """(3, n) whitened: measured less predicted."""
        return self._whitened(self.measured.T - frames.p)

    def column(self, frames: Frames, slot: str) -> Array:
        """(3, n) whitened derivative of the predicted point for a unit of `slot`."""
        return self._whitened(np.broadcast_to(frames.twist(slot)[0], (3, len(self.measured))))

    def _whitened(self, v: Array) -> Array:
        w = self.whiten
        # lower-triangular product, written out: einsum spends most of its time on the small axes
        return np.stack(
            [
                w[0, 0] * v[0],
                w[1, 0] * v[0] + w[1, 1] * v[1],
                w[2, 0] * v[0] + w[2, 1] * v[1] + w[2, 2] * v[2],
            ]
        )
