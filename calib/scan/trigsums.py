"""Sums of u exp(i H theta) over scattered angles, for many evenly spaced orders H at once.

A Fourier transform of unevenly spaced samples: every sample is spread over its neighbours on a fine grid by a
narrow Gaussian, the grid is transformed, and the Gaussian is divided out. The work grows with the readings and
with the orders, not with their product. Source: Greengard and Lee, SIAM Review 46 (2004), section 3.
"""

from __future__ import annotations

import numpy as np
import scipy.fft
from numpy.typing import NDArray
from scipy.sparse import csr_array

from calib.array import Array

_HALF_WIDTH = 10  # grid points to either side: relative error near 1e-10
_OVERSAMPLING = 2


class TrigSums:
    """Sums for `orders` (evenly spaced, J of them) over the angles `theta` (n,), rad."""

    def __init__(self, theta: Array, orders: Array) -> None:
        self.count = len(orders)
        spacing = float(orders[1] - orders[0]) if self.count > 1 else 1.0
        modes = max(self.count, 4 * _HALF_WIDTH)
        self.grid = int(scipy.fft.next_fast_len(_OVERSAMPLING * modes, real=False) or 0)
        ratio = self.grid / modes
        width = np.pi * _HALF_WIDTH / (modes**2 * ratio * (ratio - 0.5))
        middle = self.count // 2
        # The mean order is taken out beforehand, so that the transform runs from -J/2 to J/2.
        self.carrier = np.exp(1j * theta * orders[middle])[:, None]
        angle = np.mod(spacing * theta, 2.0 * np.pi)
        step = 2.0 * np.pi / self.grid
        nearest = np.floor(angle / step).astype(np.int64)
        offsets = np.arange(-_HALF_WIDTH + 1, _HALF_WIDTH + 1)
        points = nearest[:, None] + offsets
        weights = np.exp(-((points * step - angle[:, None]) ** 2) / (4.0 * width))
        sample = np.broadcast_to(np.arange(len(theta))[:, None], points.shape)
        self.spread = csr_array(
            (weights.ravel(), (np.mod(points, self.grid).ravel(), sample.ravel())),
            shape=(self.grid, len(theta)),
        )
        mode = np.arange(self.count) - middle
        self.places = np.mod(mode, self.grid)
        self.undo = (np.sqrt(np.pi / width) * np.exp(mode**2 * width))[:, None]

    def of(self, values: Array) -> NDArray[np.complex128]:
        """(J, c) complex sums of values (n, c) x exp(i order theta)."""
        grid = self.spread @ (values * self.carrier)
        return scipy.fft.ifft(grid, axis=0)[self.places] * self.undo
