"""Distances between balls of one body that contradict the rest of a fit: another bar, or a ball that moved."""

from __future__ import annotations

import numpy as np

from calib.fit.least_squares import Solution

_ASTRAY = 5.0  # standard deviations by which a distance may miss what everything else says of it
_CLEAR = 1e-9  # of a distance that nothing else shows


def astray(solution: Solution) -> list[str]:
    """The distances between balls of one body that contradict readings and stated positions, the worst first.

    Left out of the fit, one would miss it by r / (1 - h), with the variance 1 / (1 - h), h its leverage; it no longer
    speaks about the others then, so that it does not accuse them.
    """
    spans, missed = solution.at.design.model.spans, solution.at.tied[0].copy()
    hat = solution.tied @ solution.covariance @ solution.tied.T
    said, left = [], set(range(len(spans)))
    while left:
        free = np.maximum(1.0 - np.diag(hat), _CLEAR)
        worst = max(left, key=lambda k: abs(missed[k]) / np.sqrt(free[k]))
        off, sigma = missed[worst] / free[worst], abs(missed[worst]) / np.sqrt(free[worst])
        if sigma <= _ASTRAY:
            break
        span = spans[worst]
        said.append(
            f"The distance {span.name} (reading {span.reading_id}, {span.length_mm:.4f} mm) is "
            f"{off * span.u_mm:+.3f} mm from what everything else says, {sigma:.0f} standard deviations: "
            "measure it again."
        )
        left.remove(worst)
        missed = missed + hat[:, worst] * off
        hat = hat + np.outer(hat[:, worst], hat[worst]) / free[worst]
    return said
