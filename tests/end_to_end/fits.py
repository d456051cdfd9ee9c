"""A fit to the data set of a simulated campaign, whose noise is known."""

from __future__ import annotations

import numpy as np

from calib import Dataset, identify


def rms_held_out(dataset: Dataset) -> float:
    """The RMS error on validation readings, mm, of a fit that ends and finds the noise that was declared."""
    found = identify(dataset)
    assert found.converged
    assert 0.8 < found.noise_scale < 1.2, found.noise_scale
    held = dataset.validation_rows
    miss = np.linalg.norm(found.predict(dataset.conditions.take(held)) - dataset.points[held], axis=1)
    return float(np.sqrt(np.mean(miss**2)))
