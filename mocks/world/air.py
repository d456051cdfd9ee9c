"""Air temperature of the hall: two slow sines whose periods do not follow the clock."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

MEAN_C = 22.0
SWINGS_K = (1.1, 0.4)


@dataclass(frozen=True)
class Air:
    """Air temperature as a function of time: `MEAN_C` plus at most 1.5 K. Periods s, phases rad."""

    periods_s: tuple[float, float]
    phases: tuple[float, float]

    def __call__(self, t_s: float) -> float:
        """Temperature in degC at `t_s` seconds."""
        value = MEAN_C
        for swing, period, phase in zip(SWINGS_K, self.periods_s, self.phases, strict=True):
            value += swing * math.sin(2.0 * math.pi * t_s / period + phase)
        return value

    def lagged(self, t_s: float, lag_s: float, steps: int = 80) -> float:
        """Return the temperature in degC of a body that follows the air with time constant `lag_s`.

        First order, T_b' = (T - T_b) / lag, in equilibrium with the air at t = 0. The convolution integral is a
        midpoint sum over the last eight time constants.
        """
        start = max(0.0, t_s - 8.0 * lag_s)
        value = self(start) * math.exp(-(t_s - start) / lag_s)
        width = (t_s - start) / steps
        for i in range(steps):
            s = start + (i + 0.5) * width
            # exact weight of the step, so that the weights sum to one however coarse the steps are
            weight = math.exp(-(t_s - s - 0.5 * width) / lag_s) - math.exp(-(t_s - s + 0.5 * width) / lag_s)
            value += weight * self(s)
        return value


def draw_air(rng: np.random.Generator, duration_s: float) -> Air:
    """Draw an air temperature with about two slow and six faster swings in `duration_s`."""
    periods = (duration_s * rng.uniform(0.4, 0.7), duration_s * rng.uniform(0.12, 0.25))
    phases = (rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, 2.0 * math.pi))
    return Air((float(periods[0]), float(periods[1])), (float(phases[0]), float(phases[1])))
