"""An effect that was found: its size, and the evidence for it."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from calib.array import Array
from calib.diagnose.classes import Evidence
from calib.fit.identification import Identification
from calib.model.effect import Effect


@dataclass(frozen=True)
class Found:
    """An effect that was found, with the evidence for it."""

    effect: Effect
    evidence: Evidence
    values: Array  # (p,) internal units
    covariance: Array  # (p, p)
    index: str | None  # reading at which a step happened


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
