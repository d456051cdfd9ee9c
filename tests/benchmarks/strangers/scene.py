"""Campaign state that a law may use, and the displacements that a law returns."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from tests.benchmarks.strangers.arms import DOWN, Arm, Array

WAVES = 24


@dataclass(frozen=True)
class Scene:
    """Readings of a campaign, in order of time.

    `joints` and `before`, the start of the last move, are (n, N), rad or mm. `time` is in s, `air` in deg C.
    `target` is the number of the target of each reading. `targets` (t, 3) is in the flange frame and `station`, the
    position of the instrument, in the base frame; both in mm.
    """

    arm: Arm
    joints: Array
    before: Array
    time: Array
    air: Array
    target: NDArray[np.int64]
    targets: Array
    station: Array
    rng: np.random.Generator

    @property
    def count(self) -> int:
        """Number of readings."""
        return len(self.joints)

    @cached_property
    def side(self) -> Array:
        """Direction of arrival of each joint, (n, N): +1 from below, -1 from above."""
        return np.where(self.joints >= self.before, 1.0, -1.0)

    @cached_property
    def angles(self) -> Array:
        """Joints as angles, (n, N); the whole travel of a slide counts as half a turn."""
        return self.arm.usual(self.joints)

    @cached_property
    def flange(self) -> Array:
        """Flange frames in the base frame, (n, 4, 4)."""
        return self.arm.frames(self.joints)[-1]

    @cached_property
    def place(self) -> Array:
        """Positions of the target in the base frame, (n, 3), mm."""
        return self.flange[:, :3, 3] + self.turned(self.targets[self.target])

    @cached_property
    def beam(self) -> tuple[Array, Array]:
        """Directions from the instrument to the target, (n, 3), and distances, (n,), mm."""
        way = self.place - self.station
        distance = np.linalg.norm(way, axis=1)
        return way / distance[:, None], distance

    @cached_property
    def down(self) -> Array:
        """Direction of gravity in the flange frame, (n, 3)."""
        return np.einsum("nji,j->ni", self.flange[:, :3, :3], DOWN / 9.81)

    @cached_property
    def torque(self) -> Array:
        """Gravity torques (n, N), relative to the largest of each joint; zero without a torque."""
        torque = self.arm.torques(self.joints)
        return torque / np.maximum(np.max(np.abs(torque), axis=0), 1.0)

    @cached_property
    def overturning(self) -> Array:
        """Gravity moments about x and y of the base, (n, 2), relative to the largest."""
        moment = self.arm.pulls(self.joints)[0][:, 0, :2]
        return moment / max(float(np.max(np.abs(moment))), 1.0)

    @cached_property
    def share(self) -> Array:
        """Elapsed share of the campaign, (n,), 0 to 1."""
        return (self.time - self.time[0]) / (self.time[-1] - self.time[0])

    def turned(self, vectors: Array) -> Array:
        """Turn vectors (n, 3) of the flange frame into the base frame."""
        return np.einsum("nij,nj->ni", self.flange[:, :3, :3], vectors)

    def field(self, of: Array, width: float, parts: int) -> Array:
        """Draw a smooth random field (n, parts) over coordinates (n, d), correlated over `width`."""
        waves = self.rng.normal(size=(of.shape[1], WAVES, parts)) / width
        phase = self.rng.uniform(0.0, 2.0 * math.pi, (WAVES, parts))
        return np.cos(np.einsum("nd,dwp->nwp", of, waves) + phase).sum(axis=1) * math.sqrt(2.0 / WAVES)

    def direction(self) -> Array:
        """Draw a random direction, (3,)."""
        drawn = self.rng.normal(size=3)
        return drawn / np.linalg.norm(drawn)


@dataclass(frozen=True)
class Moved:
    """Displacements caused by a law, of the order of 1 in small units.

    `joints` maps a joint number to (n,) offsets in 1e-4 rad, or in 0.1 mm for a sliding joint. `lean` (n, 3) tilts
    the base, 1e-4 rad. `tool` (n, 3) is in the flange frame and `point` (n, 3) in the base frame, both in 0.1 mm.
    """

    joints: dict[int, Array] = field(default_factory=dict)
    lean: Array | None = None
    tool: Array | None = None
    point: Array | None = None


Act = Callable[[Scene], Moved]


@dataclass(frozen=True)
class Law:
    """Law that the library does not contain, with the places at which a report may locate it.

    A place is the beginning of a driver's name, or `on JOINT` for the joint on which the law acts. If `bend`, the
    law needs gravity about the joints; if `wrist`, it needs five turning joints.
    """

    act: Act
    places: tuple[str, ...]
    bend: bool
    wrist: bool

    @property
    def name(self) -> str:
        """Name of the law: the name of its function."""
        return self.act.__name__

    def fits(self, arm: Arm) -> bool:
        """Return whether the law can act on an arm."""
        return not ((self.bend or self.wrist) and arm.slides)


LAWS: dict[str, Law] = {}


def law(*places: str, bend: bool = False, wrist: bool = False) -> Callable[[Act], Law]:
    """Enters a law under the name of its function."""

    def enter(act: Act) -> Law:
        made = Law(act, places, bend, wrist)
        LAWS[made.name] = made
        return made

    return enter
