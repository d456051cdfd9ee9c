"""Type of all numerical arrays: float64. The docstring of each function gives the shape."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
