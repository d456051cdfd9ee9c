"""The common part of a campaign's blocks of every kind: set, targets, approach and settling, and recipe.

A recipe turns a block into visits of the robot for one cell. A pose is reached over its approach point q - side x
length (Nubiola, thesis 2.5), the length that of its block or drawn with the pose, or over a point that the recipe
names. Joints deg, and mm where they slide, rounded to what every controller takes; the rounded values are the record.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Literal, Protocol

import numpy as np

from acquisition.cell.cell import Cell
from calib.text import TomlTable
from drivers.errors import ConfigError

DECIMALS = 4  # a stock open_abb request carries four
_LONGER, _LONGEST_DEG = 3.0, 30.0  # last moves of drawn poses: up to three times the shortest

Joints = tuple[float, ...]
Sides = Literal["one", "both"]


class RandomStream(IntEnum):
    """Streams of random numbers from the seed of a campaign, one for each thing that is drawn."""

    POSE, SIDE, ORDER, REFERENCE, POSTURE, REACH = range(6)


@dataclass(frozen=True)
class Approach:
    """The point from which the last move to a pose starts: `offset_deg` away in every joint, its sign drawn if `both`.

    longest_deg: the length of each pose's last move is drawn up to this; None: the kind of block says it.
    """

    offset_deg: float = -5.0
    sides: Sides = "one"
    longest_deg: float | None = None

    @property
    def side(self) -> int:
        """+1 from below, -1 from above, where it is one and the same."""
        return 1 if self.offset_deg < 0 else -1

    @property
    def usual_longest_deg(self) -> float:
        """Up to which lengths are drawn beside poses that are drawn too."""
        shortest = abs(self.offset_deg)
        return self.longest_deg or min(_LONGER * shortest, max(_LONGEST_DEG, shortest))

    def point(self, joints_deg: Joints, sides: Iterable[int], reach_deg: float | None = None) -> Joints:
        """The start of the last move, deg: from below (side +1) it lies below the pose. reach_deg: its own length."""
        reach = abs(self.offset_deg) if reach_deg is None else reach_deg
        return rounded(q - side * reach for q, side in zip(joints_deg, sides, strict=True))


@dataclass(frozen=True)
class Settle:
    """The rest of the robot before a reading, s; `check`: until two read-backs in a row agree as well."""

    seconds: float
    check: bool


@dataclass(frozen=True)
class BlockVisit:
    """A pose to be visited, before it has its place in the order. `what` names it within its block.

    distances: target and ball on the base of each, where a ballbar measures them, or two balls of one body where the
    arm takes no part (no joints). waypoints: where a path goes on to. readings: of every target, while the arm rests.
    """

    what: str
    joints_deg: Joints
    sides: tuple[int, ...]
    approach_deg: Joints
    distances: Sequence[tuple[str, str]] = ()
    waypoints: tuple[Joints, ...] = ()
    readings: int = 1


@dataclass(frozen=True)
class Site:
    """The site of a block: its cell, its number (from 0), its targets and its approach.

    taken: poses of the calibration blocks before a block to judge by, deg.
    """

    cell: Cell
    seed: int
    number: int
    targets: tuple[str, ...]
    approach: Approach
    taken: tuple[Joints, ...] = ()

    def rng(self, stream: RandomStream) -> np.random.Generator:
        """A random generator that belongs to this block alone."""
        return np.random.default_rng([self.seed, stream, self.number])

    def visit(
        self,
        what: str,
        joints_deg: Joints,
        sides: tuple[int, ...],
        distances: Sequence[tuple[str, str]] = (),
        reach_deg: float | None = None,
    ) -> BlockVisit:
        """A visit with the approach of its block, or with another length of the last move."""
        return BlockVisit(
            what, joints_deg, sides, self.approach.point(joints_deg, sides, reach_deg), distances
        )

    def sides(self) -> tuple[int, ...]:
        """The usual side on every joint, or one drawn for each."""
        joints = self.cell.robot.model.joints
        if self.approach.sides == "one":
            return (self.approach.side,) * joints
        return tuple(int(s) for s in self.rng(RandomStream.SIDE).choice((-1, 1), size=joints))

    def posture(self, key: str, joints_deg: Joints) -> Joints:
        """A pose of a file, rounded. Raises ConfigError when it is not one of this robot."""
        if len(joints_deg) != self.cell.robot.model.joints:
            raise ConfigError(
                f"block {self.number + 1}, {key} has {len(joints_deg)} joints, "
                f"the robot {self.cell.robot.model.joints}"
            )
        return rounded(joints_deg)


class Recipe(Protocol):
    """A kind of block. `ordered`: its poses stay together and in order when a campaign is shuffled; `lengths`: it
    measures distances.
    """

    @property
    def ordered(self) -> bool: ...

    @property
    def lengths(self) -> bool: ...

    def visits_at(self, site: Site) -> list[BlockVisit]:
        """Visits of the block in a cell. Raises ConfigError for what this cell cannot do."""
        ...


@dataclass(frozen=True)
class Block:
    """One block. `targets` None: all of the cell. `new_station`: the instrument is set up anew before it."""

    kind: str
    set: str
    targets: tuple[str, ...] | None
    approach: Approach
    settle: Settle
    new_station: bool
    recipe: Recipe


def rounded(joints_deg: Iterable[float]) -> Joints:
    """The joint angles as they are sent and recorded."""
    return tuple(round(float(q), DECIMALS) for q in joints_deg)


def read_approach(table: TomlTable, default: Approach) -> Approach:
    """The `approach` table of a campaign or a block. Raises ConfigError."""
    table.only(("offset_deg", "sides", "longest_deg"))
    offset = table.number("offset_deg", default.offset_deg, low=-30.0, high=30.0)
    if abs(offset) < 0.1:
        raise table.refuse(
            "offset_deg", f"is {offset:g}.", "Without an approach, backlash spoils every reading."
        )
    both = table.text("sides", default.sides, ("one", "both")) == "both"
    longest = None if "offset_deg" in table.values else default.longest_deg
    if "longest_deg" in table.values:
        longest = table.number("longest_deg", low=abs(offset), high=max(_LONGEST_DEG, abs(offset)))
    return Approach(offset, "both" if both else "one", longest)


def read_settle(table: TomlTable, default: Settle) -> Settle:
    """Read `settle_s` and `settle_check` of a campaign or a block. Raises ConfigError."""
    return Settle(
        table.number("settle_s", default.seconds, low=0.0, high=3600.0),
        table.flag("settle_check", default.check),
    )
