"""What a law may know of a campaign, and what it may move."""

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
    """Readings in order of time: joints (n, N), where the last move began, s, deg C, which target (n,), the targets
    (t, 3) in the flange frame and the instrument's place in the base frame, mm."""

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
        """(n, N) +1 where a joint came from below, -1 from above."""
        return np.where(self.joints >= self.before, 1.0, -1.0)

    @cached_property
    def angles(self) -> Array:
        """(n, N) joints, a slide's travel as half a turn."""
        return self.arm.usual(self.joints)

    @cached_property
    def flange(self) -> Array:
        """(n, 4, 4) frames of the flange in the base frame."""
        return self.arm.frames(self.joints)[-1]

    @cached_property
    def place(self) -> Array:
        """(n, 3) the target in the base frame, mm."""
        return self.flange[:, :3, 3] + self.turned(self.targets[self.target])

    @cached_property
    def beam(self) -> tuple[Array, Array]:
        """(n, 3) direction from the instrument to the target, (n,) distance, mm."""
        way = self.place - self.station
        distance = np.linalg.norm(way, axis=1)
        return way / distance[:, None], distance

    @cached_property
    def down(self) -> Array:
        """(n, 3) direction of gravity in the flange frame."""
        return np.einsum("nji,j->ni", self.flange[:, :3, :3], DOWN / 9.81)

    @cached_property
    def torque(self) -> Array:
        """(n, N) of gravity, over its largest; zero where there is none."""
        torque = self.arm.torques(self.joints)
        return torque / np.maximum(np.max(np.abs(torque), axis=0), 1.0)

    @cached_property
    def overturning(self) -> Array:
        """(n, 2) moments of gravity about x and y of the base, over the largest."""
        moment = self.arm.pulls(self.joints)[0][:, 0, :2]
        return moment / max(float(np.max(np.abs(moment))), 1.0)

    @cached_property
    def share(self) -> Array:
        """(n,) of the campaign that is over, 0 to 1."""
        return (self.time - self.time[0]) / (self.time[-1] - self.time[0])

    def turned(self, vectors: Array) -> Array:
        """(n, 3) vectors of the flange frame in the base frame."""
        return np.einsum("nij,nj->ni", self.flange[:, :3, :3], vectors)

    def field(self, of: Array, width: float, parts: int) -> Array:
        """(n, parts) a smooth random field over coordinates (n, d), correlated over `width`."""
        waves = self.rng.normal(size=(of.shape[1], WAVES, parts)) / width
        phase = self.rng.uniform(0.0, 2.0 * math.pi, (WAVES, parts))
        return np.cos(np.einsum("nd,dwp->nwp", of, waves) + phase).sum(axis=1) * math.sqrt(2.0 / WAVES)

    def direction(self) -> Array:
        """(3,) a direction at random."""
        drawn = self.rng.normal(size=3)
        return drawn / np.linalg.norm(drawn)


@dataclass(frozen=True)
class Moved:
    """What a law moves, of size 1 or so: joints by number (n,), 1e-4 rad or 0.1 mm of a slide; lean of the base (n, 3),
    1e-4 rad; the tool in the flange frame (n, 3) and the point read in the base frame (n, 3), 0.1 mm."""

    joints: dict[int, Array] = field(default_factory=dict)
    lean: Array | None = None
    tool: Array | None = None
    point: Array | None = None


Act = Callable[[Scene], Moved]


@dataclass(frozen=True)
class Law:
    """A law that the library does not hold, and where a report may say that it lives: beginnings of a driver's name, or
    `on JOINT` of what it acts on. bend: it needs gravity about the joints; wrist: it needs five joints that turn."""

    act: Act
    places: tuple[str, ...]
    bend: bool
    wrist: bool

    @property
    def name(self) -> str:
        """Its name."""
        return self.act.__name__

    def fits(self, arm: Arm) -> bool:
        """Whether it can act on an arm."""
        return not ((self.bend or self.wrist) and arm.slides)


LAWS: dict[str, Law] = {}


def law(*places: str, bend: bool = False, wrist: bool = False) -> Callable[[Act], Law]:
    """Enters a law under the name of its function."""

    def enter(act: Act) -> Law:
        made = Law(act, places, bend, wrist)
        LAWS[made.name] = made
        return made

    return enter
