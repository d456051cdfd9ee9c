"""Structure that no textbook law describes: smooth random fields, label outside:NAME.

The group is outside. Each component of the displacement is a sum of cosines, of unit variance times `rms` mm.
Their directions, wavelengths and phases are random (random Fourier features of a Gaussian kernel, Rahimi and
Recht 2007).
"""

from __future__ import annotations

import math

import numpy as np

from mocks.world.arm import Sight
from mocks.world.draw import Material
from mocks.world.effect import Effect, Values

WAVES = 16
JOINT_LENGTH_DEG = 50.0
WORKSPACE_LENGTH_MM = 200.0
TIME_LENGTH_SHARE = 0.08
FIELD_JOINTS = (1, 2, 4)  # joints 2, 3, 5: those that pose the arm and load it


class Field:
    """A smooth random vector field: `n` coordinates in units of the correlation length -> (3,)."""

    def __init__(self, rng: np.random.Generator, n: int) -> None:
        self.waves = rng.normal(size=(3, WAVES, n))
        self.phases = rng.uniform(0.0, 2.0 * math.pi, size=(3, WAVES))

    def __call__(self, coordinates: list[float]) -> np.ndarray:
        """Value (3,) at `coordinates` (n,)."""
        return math.sqrt(2.0 / WAVES) * np.cos(self.waves @ np.array(coordinates) + self.phases).sum(axis=1)


def joint_field(m: Material) -> Effect:
    """Displace points smoothly with joints 2, 3 and 5 (correlation length 50 deg)."""
    field = Field(m.rng, len(FIELD_JOINTS))

    def act(sight: Sight, p: Values) -> None:
        joints = [sight.state.joints_deg[i] / JOINT_LENGTH_DEG for i in FIELD_JOINTS]
        sight.point = sight.point + p["rms"] * field(joints)

    return Effect(m.label, "point", act, {"rms": 0.05}, {"rms": "mm"}, shape="joint_field")


def workspace_field(m: Material) -> Effect:
    """Displace points smoothly with their place in the workspace (correlation length 200 mm)."""
    field = Field(m.rng, 3)

    def act(sight: Sight, p: Values) -> None:
        place = [float(v) / WORKSPACE_LENGTH_MM for v in sight.point]
        sight.point = sight.point + p["rms"] * field(place)

    return Effect(m.label, "point", act, {"rms": 0.05}, {"rms": "mm"}, shape="workspace_field")


def time_wander(m: Material) -> Effect:
    """Let the instrument's frame wander in time (correlation length 8 % of the campaign)."""
    field = Field(m.rng, 1)
    length_s = TIME_LENGTH_SHARE * m.session.duration_s

    def act(sight: Sight, p: Values) -> None:
        sight.point = sight.point + p["rms"] * field([sight.state.t_s / length_s])

    return Effect(m.label, "instrument", act, {"rms": 0.05}, {"rms": "mm"}, shape="time_wander")
