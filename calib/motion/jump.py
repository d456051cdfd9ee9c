"""The jump of a clock that was set while both were running: their offset, along a recording, has a step."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array

_SIGMA = 6.0
_BESIDE, _FEWEST = 6, 3  # offsets to either side of a step that are compared
_OF_MEDIAN = 1.2533  # standard error of a median beside that of a mean
_LEAST_S = 1e-6


@dataclass(frozen=True)
class Step:
    """A step of `size` s among offsets, at index `cut`; level: the offset before it, s."""

    cut: int
    size: float
    level: float


def step_in(offsets: Array, least: float) -> Step | None:
    """The clearest step among offsets (b,) of equal stretches of a recording, s; None where there is none.

    Medians of some offsets before and after are compared, the slope of all between them taken off; a step is more than
    `least` seconds and six standard errors. Scatter and slope are those from one offset to the next (their medians), so
    neither a few wild offsets nor a second step hide the first one.
    """
    if len(offsets) < 2 * _FEWEST:
        return None
    difference = np.diff(offsets)
    slope = float(np.median(difference))
    scatter = max(1.4826 * float(np.median(np.abs(difference - slope))) / np.sqrt(2.0), _LEAST_S)
    strongest, best = _SIGMA, None
    for cut in range(_FEWEST, len(offsets) - _FEWEST + 1):
        before, after = offsets[max(cut - _BESIDE, 0) : cut], offsets[cut : cut + _BESIDE]
        level = float(np.median(before))
        size = float(np.median(after)) - level - 0.5 * (len(before) + len(after)) * slope
        u = scatter * _OF_MEDIAN * float(np.sqrt(1.0 / len(before) + 1.0 / len(after)))
        if abs(size) > max(least, strongest * u):
            strongest, best = abs(size) / u, Step(cut, size, level)
    return best
