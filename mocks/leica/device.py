"""Simulated Leica tracker without its protocol, based on `mocks.shared.tracker_device`.

If the cell declares the normal of an SMR, the tracker sees it within 30 deg of this normal when no limb of the
arm is between. A target without a normal is seen from everywhere, like one that a person turns. After a broken
beam, the tracker finds its SMR again by itself (PowerLock). If PowerLock is switched off, it finds it only
after pointing. The head drifts while it warms up, and a wrong weather makes every distance too long or too
short:

    p' = station + (1 + s) R(w) (p - station),  w = w0 exp(-t / 1800 s) about the vertical,
    s = 1e-6 (-0.95 (T - T_set) + 0.27 (P - P_set))    T in degC, P in hPa
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mocks.shared.arm_device import ArmDevice
from mocks.shared.at_rest import hidden_by, limbs
from mocks.shared.clock import CellClock
from mocks.shared.mbp import BadRequest
from mocks.shared.tracker_device import TrackerDevice
from mocks.world import World
from mocks.world.transforms import rz

CONE_DEG = 30.0
WARM_UP_RAD, WARM_UP_S = 10e-6, 1800.0
PRESSURE_HPA, HUMIDITY = 1013.2, 45.0
REFLECTORS_MM = (12.7, 22.2, 38.1)
Vector = NDArray[np.float64]


class LeicaDevice(TrackerDevice):
    """State of one AT960 or AT901.

    `assumed` is (T, P) set by hand, or None for the values of the weather station.
    """

    def __init__(
        self,
        world: World,
        arm: ArmDevice,
        clock: CellClock,
        nests: Mapping[str, Sequence[float]],
        normals: Mapping[str, Sequence[float]],
    ) -> None:
        super().__init__(world, arm, clock, nests)
        self.mode = "ADM"
        self.normals = {name: np.asarray(n, dtype=float) for name, n in normals.items()}
        self.power_lock = True
        self.lost = False
        self.assumed: tuple[float, float] | None = None
        self.reflector_mm = 38.1

    def air_c(self) -> float:
        return round(self.world.air_c(self.clock.now()), 2)

    def sees(self, name: str) -> bool:
        """Return whether the SMR of a nest can send the beam back now."""
        if name not in self.normals:
            return True
        frame, place = self.world.flange(self.arm_state()), self.true_world(name)
        ray, normal = self.world.station - place, frame[:3, :3] @ self.normals[name]
        along = float(normal @ ray) / float(np.linalg.norm(normal) * np.linalg.norm(ray))
        return along >= math.cos(math.radians(CONE_DEG)) and not hidden_by(
            limbs(self.world, self.arm), self.world.station, place
        )

    def break_beam(self) -> None:
        super().break_beam()
        self.lost = True

    def check_ready(self) -> None:
        super().check_ready()
        if self.lost and not self.power_lock:
            raise BadRequest(302, "beam was broken: point at the target again", retry=True)
        self.lost = False

    def point(self, tracker_mm: Vector, radius_mm: float) -> str:
        self.lost = self.lost and self.beam_broken
        name = super().point(tracker_mm, radius_mm)
        if not self.sees(name):
            self.held = None
            raise BadRequest(310, "no target there that looks at the tracker", retry=True)
        return name

    def choose(self, name: str | None) -> str:
        really = super().choose(name)
        if not self.sees(really):
            self.held = None
            raise BadRequest(302, "target turned away or hidden", retry=True)
        return really

    def scale(self) -> float:
        """Relative error of every distance."""
        if self.assumed is None:
            return 0.0
        t, p = self.assumed
        return 1e-6 * (-0.95 * (self.air_c() - t) + 0.27 * (PRESSURE_HPA - p))

    def _indicated_world(self, name: str) -> Vector:
        beam = super()._indicated_world(name) - self.world.station
        drift = WARM_UP_RAD * math.exp(-self.clock.now() / WARM_UP_S)
        return self.world.station + (1.0 + self.scale()) * (rz(drift)[:3, :3] @ beam)
