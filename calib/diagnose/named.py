"""An effect that was found: its size, and the evidence for it."""

from __future__ import annotations

from dataclasses import dataclass

from calib.array import Array
from calib.diagnose.classes import Evidence
from calib.model.effect import Effect


@dataclass(frozen=True)
class Found:
    """An effect that was found, with the evidence for it."""

    effect: Effect
    evidence: Evidence
    values: Array  # (p,) internal units
    covariance: Array  # (p, p)
    index: str | None  # reading at which a step happened
