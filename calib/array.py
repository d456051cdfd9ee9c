"""The type of all arrays of numbers: float64; the docstring of each function gives the shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
