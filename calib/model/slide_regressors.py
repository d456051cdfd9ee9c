"""Regressors of joints that slide: smooth curves over the travel, and the travel times the warmth of the air."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.model.axis import Axis


@dataclass(frozen=True)
class HalfSines:
    """Sine of `count` half waves over the travel of a joint that slides, from low to high, mm."""

    joint: int
    count: int
    low: float
    high: float

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) from -1 to 1."""
        return np.sin(_phase(self, conditions))

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The place along the axis."""
        return Axis.angle(self.joint, conditions)


@dataclass(frozen=True)
class HalfCosines:
    """Cosine of `count` half waves over the travel of a joint that slides, from low to high, mm."""

    joint: int
    count: int
    low: float
    high: float

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) from -1 to 1."""
        return np.cos(_phase(self, conditions))

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The place along the axis."""
        return Axis.angle(self.joint, conditions)


@dataclass(frozen=True)
class WarmTravel:
    """Place of a joint that slides, mm, times the air temperature above `reference_c`, K."""

    joint: int
    reference_c: float

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) mm K."""
        return conditions.joints[:, self.joint - 1] * (conditions.temperature - self.reference_c)


def _phase(wave: HalfSines | HalfCosines, conditions: Conditions) -> Array:
    """(n,) rad, from 0 at the low end of the travel to pi times the number of half waves at the high one."""
    along = (conditions.joints[:, wave.joint - 1] - wave.low) / (wave.high - wave.low)
    return np.pi * wave.count * along
