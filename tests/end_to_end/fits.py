"""A fit to the data set of a simulated campaign, whose noise is known."""

from __future__ import annotations

import numpy as np

from calib import Dataset, identify


def rms_held_out(dataset: Dataset) -> float:
    """Return the RMS error of a fit on validation readings, mm.

    The fit must converge and find the declared noise.
    """
    found = identify(dataset)
    assert found.converged
    assert 0.8 < found.noise_scale < 1.2, found.noise_scale
    held = dataset.validation_rows
    miss = np.linalg.norm(found.predict(dataset.conditions.take(held)) - dataset.points[held], axis=1)
    return float(np.sqrt(np.mean(miss**2)))
