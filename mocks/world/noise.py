"""Noise of the laser tracker along the beam (interferometer) and across it (encoders).

1 sigma = fixed + ppm x distance, normal and independent along the beam and in two directions across it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mocks.world.transforms import Vector


@dataclass(frozen=True)
class TrackerNoise:
    """The four figures of the maker's specification, 1 sigma: mm and ppm (1e-6 of the distance)."""

    range_mm: float = 0.010
    range_ppm: float = 2.0
    transverse_mm: float = 0.010
    transverse_ppm: float = 6.0

    def sigmas(self, distance_mm: float) -> tuple[float, float]:
        """Standard deviations (along, across) in mm at `distance_mm`."""
        along = self.range_mm + 1e-6 * self.range_ppm * distance_mm
        across = self.transverse_mm + 1e-6 * self.transverse_ppm * distance_mm
        return along, across

    def variance_sum(self, point: Vector, station: Vector) -> float:
        """Trace of the covariance in mm^2 of a reading of `point` from `station` (3,)."""
        along, across = self.sigmas(float(np.linalg.norm(point - station)))
        return along**2 + 2.0 * across**2

    def draw(self, point: Vector, station: Vector, rng: np.random.Generator) -> Vector:
        """Draw one random error (3,) mm of a reading of `point` from `station`."""
        beam = point - station
        distance = float(np.linalg.norm(beam))
        beam = beam / distance
        along, across = self.sigmas(distance)
        error = across * rng.normal(size=3)
        error -= beam * float(beam @ error)  # isotropic noise without its part along the beam
        return error + beam * (along * float(rng.normal()))
