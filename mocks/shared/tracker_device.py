"""Simulated laser tracker without a protocol: its SMRs, its beam and its visibility.

The tracker's own frame is an unknown rigid transform of the world frame. It is within 20 mm of the station of
the cell file, turned by any angle about the vertical and levelled to 0.05 deg. It is drawn from the seed:
p_tracker = R^T (p_world - station). World frame and tracker meet only through the nests on the table.

If `seated` is None, every nest has an SMR, measured by name or by pointing. If `seated` is a name, there is one
SMR, and the beam measures its true position for any requested name (the operator's mislabelled reading).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import CellClock
from mocks.shared.mbp import BadRequest, pairs
from mocks.world import ArmState, World
from mocks.world.arm import Sight

FRAME_STREAM, SAMPLE_STREAM = 20, 21
SAMPLE_SIGMA_MM = 0.02  # scatter of single samples per axis, on top of the world's noise of an average
Vector = NDArray[np.float64]


def tracker_frame(seed: int, station_mm: Vector) -> tuple[Vector, Vector]:
    """Rotation (3, 3) and origin (3,) mm of the tracker's frame in the world."""
    rng = np.random.default_rng([seed, FRAME_STREAM])
    yaw = rng.uniform(-math.pi, math.pi)
    a, b = np.radians(rng.normal(scale=0.05, size=2))
    turn = np.array([[math.cos(yaw), -math.sin(yaw), 0], [math.sin(yaw), math.cos(yaw), 0], [0, 0, 1]])
    tilt_x = np.array([[1, 0, 0], [0, math.cos(a), -math.sin(a)], [0, math.sin(a), math.cos(a)]])
    tilt_y = np.array([[math.cos(b), 0, math.sin(b)], [0, 1, 0], [-math.sin(b), 0, math.cos(b)]])
    return turn @ tilt_x @ tilt_y, station_mm + rng.uniform(-20, 20, size=3)


class TrackerDevice:
    """State of the tracker. Lengths mm, times simulated s."""

    def __init__(
        self, world: World, arm: ArmDevice, clock: CellClock, nests: Mapping[str, Sequence[float]]
    ) -> None:
        self.world = world
        self.arm = arm
        self.clock = clock
        self.nests = {name: np.asarray(p, dtype=float) for name, p in nests.items()}
        self.rotation, self.origin = tracker_frame(world.seed, world.station)
        self.state = "READY"
        self.mode = "IFM_ADM"
        self.beam_broken = False
        self.homed = True  # IFM counts from the home position; a broken beam loses the count
        self.weather = True
        self.status_has_weather = (
            True  # False: a bridge whose STATUS tells its state alone, as bridge.md allows
        )
        self.seated: str | None = None
        self.hidden: set[str] = set()  # nests whose SMR is missing or turned away
        self.held: str | None = None
        self.readings = 0
        self._rng = np.random.default_rng([world.seed, SAMPLE_STREAM])

    # -- the cell as the tracker finds it -----------------------------------------------------------------

    def names(self) -> tuple[str, ...]:
        return (*self.world.targets, *self.nests)

    def arm_state(self) -> ArmState:
        """Return the current state of the arm, as the world needs it."""
        now = self.clock.now()
        return ArmState(
            joints_deg=self.arm.actual_deg(),
            previous_deg=self.arm.previous_deg,
            sides=self.arm.sides,
            t_s=now,
            t_air_c=self.world.air_c(now),
            reading=self.arm.moves,
        )

    def true_world(self, name: str) -> Vector:
        """Return the true position of the SMR of a nest in the world frame, mm."""
        if name in self.nests:
            return self.nests[name]
        return np.array(self.world.true_point(self.arm_state(), name))

    def _indicated_world(self, name: str) -> Vector:
        state = self.arm_state()
        if name not in self.nests:
            return np.array(self.world.measured_point(state, name))
        sight = Sight(state, self.nests[name].copy(), self.world.station)
        for effect in self.world.effects:  # a drifting tracker drifts for the nests as well
            if effect.stage == "instrument":
                effect.act(sight, effect.values)
        return sight.point + self.world.noise.draw(sight.point, self.world.station, self._rng)

    def to_tracker(self, point: Vector) -> Vector:
        return self.rotation.T @ (point - self.origin)

    # -- orders --------------------------------------------------------------------------------------------

    def check_ready(self) -> None:
        """Check that a reading can be taken.

        Raises
        ------
        BadRequest
            2xx, 301 or 610: no reading can be taken.
        """
        codes = {"OFF": 201, "WARMING": 202, "ERROR": 201, "ESTOP": 610}
        if self.state in codes:
            raise BadRequest(codes[self.state], f"tracker is {self.state}", retry=True)
        if not self.weather:
            raise BadRequest(204, "no weather data")
        if self.beam_broken:
            raise BadRequest(301, "beam broken", retry=True)
        if self.mode == "IFM" and not self.homed:
            raise BadRequest(301, "beam was broken: distance lost until HOME")

    def break_beam(self) -> None:
        self.beam_broken, self.homed, self.held = True, False, None

    def point(self, tracker_mm: Vector, radius_mm: float) -> str:
        """Point at a place and hold the nearest SMR.

        Raises
        ------
        BadRequest
            310 if no SMR is near enough, 311 if the place is inside the tracker.
        """
        self.check_ready()
        self.held = None
        if float(np.linalg.norm(tracker_mm)) < 10.0:
            raise BadRequest(311, "inside the tracker")
        candidates = [n for n in self.names() if n not in self.hidden and self.seated in (None, n)]
        far = {n: float(np.linalg.norm(self.to_tracker(self.true_world(n)) - tracker_mm)) for n in candidates}
        nearest = min(far, key=lambda n: far[n], default=None)
        if nearest is None or far[nearest] > radius_mm:
            raise BadRequest(310, f"no target within {radius_mm:g} mm", retry=True)
        self.held = nearest
        return nearest

    def sample(self, fields: dict[str, str]) -> str:
        """Return one line of a stream: the SMR that the beam holds.

        Raises
        ------
        BadRequest
            No reading can be taken, or the target is lost.
        """
        self.check_ready()
        if self.held is None or self.held in self.hidden:
            raise BadRequest(302, "target lost", retry=True)
        x, y, z = (float(v) for v in self.to_tracker(self._indicated_world(self.held)))
        return pairs(x=x, y=y, z=z, status=0)

    def choose(self, name: str | None) -> str:
        """Return the nest that a reading of `name` really measures.

        Raises
        ------
        BadRequest
            103 if the name is unknown, 302 if the target is lost.
        """
        if name is not None and name not in self.names():
            raise BadRequest(103, f"no target {name}")
        really = self.seated or name or self.held
        if really is None or really in self.hidden:
            raise BadRequest(302, "target lost", retry=True)
        self.held = really
        return really

    def average(self, name: str, samples: int) -> tuple[Vector, Vector]:
        """Return one reading in the tracker's frame and the scatter of its samples per axis, mm."""
        point = self.to_tracker(self._indicated_world(name))
        self.readings += 1
        mean = self._rng.normal(scale=SAMPLE_SIGMA_MM / math.sqrt(samples), size=3)
        if samples == 1:
            return point + mean, np.zeros(3)
        scatter = SAMPLE_SIGMA_MM * np.sqrt(self._rng.chisquare(samples - 1, size=3) / (samples - 1))
        return point + mean, scatter
