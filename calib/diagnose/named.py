"""An effect that was found: its size, and the evidence for it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from calib.array import Array
from calib.diagnose.classes import Evidence
from calib.fit.identification import Identification
from calib.model.effect import Effect
from calib.scan.physics import bounds_of, impossible

COVERAGE = 2.0  # k of the expanded uncertainty, about 95 %


@dataclass(frozen=True)
class Found:
    """An effect that was found, with the evidence for it.

    values (p,) and covariance (p, p) in internal units; index: id of the reading at which a step happened. shape_std:
    standard errors of what was scanned, by name as in `Effect.shape`. between: ids of the readings between which a step
    happened, with a probability of 95 %: the last before it and the first after it.
    """

    effect: Effect
    evidence: Evidence
    values: Array
    covariance: Array
    index: str | None
    shape_std: Mapping[str, float] = field(default_factory=dict)
    between: tuple[str, str] | None = None

    @cached_property
    def amplitude(self) -> tuple[float, float, str]:
        """Size, standard error and unit, as `Effect.amplitude`."""
        return self.effect.amplitude(self.values, self.covariance)

    @property
    def confirmed(self) -> bool:
        """Whether the size exceeds its expanded uncertainty."""
        value, std, _ = self.amplitude
        return abs(value) > COVERAGE * std

    @property
    def usual(self) -> float | None:
        """Usual size in the unit of the amplitude; None if the library states none, as for a curve of a gear, whose
        sizes the readings state."""
        same = [p for p in self.effect.parameters if p.unit == self.amplitude[2]]
        if self.effect.is_curve or any(p.size is None or p.centre is not None for p in same):
            return None
        return math.hypot(*(p.size for p in same if p.size is not None))

    @property
    def beyond_usual(self) -> bool:
        """Whether the size exceeds the usual one, so that a technician should look for its cause."""
        return self.usual is None or abs(self.amplitude[0]) > self.usual

    @property
    def impossible(self) -> bool:
        """Whether the values lie beyond what physics allows, as a negative compliance does; noise is no excuse."""
        bounds = bounds_of(self.effect)
        return bounds is not None and bool(impossible(bounds, self.values, np.zeros(len(self.values))))


def resized(found: Found, fitted: Identification) -> Found:
    """A finding with the values that another fit has for it."""
    effect = next(e for e in fitted.model.effects if e.label == found.effect.label)
    positions = fitted.model.positions(effect)
    return replace(
        found,
        effect=effect,
        values=fitted.estimate[positions],
        covariance=fitted.covariance[np.ix_(positions, positions)],
    )
