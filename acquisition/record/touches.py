"""Cups of the base at the places where the robot touched them, with three measured sides.

A person jogs a ball of the tool into every cup; the nominal robot gives the position of the ball. These points have the
errors of the robot, while the ballbar determines the shape of their triangle to a micrometre. The triangle of the
measured sides is therefore fitted to the points (`calib.arm.with_sides`). The cups are then where the robot believes
them to be. The same errors are in its poses, so that it reaches the stances of the legs more closely than with any
other knowledge of the cups. Source: Nubiola, thesis, section 4.2, (4.10) to (4.12). Lengths in mm.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from acquisition.cell.cell import TAUGHT_MM, Cell, point
from acquisition.cell.workspace import targets_at
from acquisition.record.readings import spans_of, touches_of
from acquisition.record.store import PlannedReading, RecordStore
from calib.arm import WorldFrame, of_base_points, with_sides
from calib.array import Array
from calib.text import Vector

AGREE_MM = 3.0 * 2.0**0.5 * TAUGHT_MM
"""Largest difference of a side from two touches: three standard deviations of what a robot as it came makes of it."""

Pair = tuple[str, str]


@dataclass(frozen=True)
class Taught:
    """The cups as touched, by name.

    Attributes
    ----------
    sides_mm
        Sides of the triangle of the first three, if the bar measured them.
    readings
        Numbers of the attempts from which it was created.
    poses, side_poses
        Planned readings of each touch and of each side.
    """

    touched_mm: Mapping[str, Vector]
    sides_mm: Mapping[Pair, float]
    readings: tuple[int, ...]
    poses: Mapping[str, int]
    side_poses: tuple[int, ...] = ()

    @property
    def corners(self) -> tuple[str, ...]:
        """The three cups whose triangle is measured."""
        return tuple(self.touched_mm)[:3]

    @property
    def sides(self) -> tuple[float, float, float] | None:
        """The sides d12, d23, d31 of the triangle, mm; None if one of them was not measured."""
        one, two, three = self.corners
        of = self.sides_mm.get
        d12, d23, d31 = of((one, two)), of((two, three)), of((one, three))
        return None if d12 is None or d23 is None or d31 is None else (d12, d23, d31)

    @cached_property
    def nests_mm(self) -> dict[str, Vector]:
        """Places of the cups, mm.

        Raises
        ------
        DataError
            The sides make no triangle.
        ValueError
            The touched points lie on a line.
        """
        if self.sides is None:
            return dict(self.touched_mm)
        found = with_sides(self._touched, self.sides)
        return {**self.touched_mm, **{n: point(p) for n, p in zip(self.corners, found, strict=True)}}

    @property
    def frame(self) -> WorldFrame | None:
        """The robot in the frame of the cups, or None without sides.

        The origin is in the first cup, x points to the second, z is normal. Errors are those of `nests_mm`.
        """
        return None if self.sides is None else of_base_points(self._touched, self.sides)

    @property
    def disagreements(self) -> dict[Pair, float]:
        """Sides whose touched length differs from the bar by more than the error of a robot, mm."""
        off = {
            pair: float(np.linalg.norm(np.subtract(self.touched_mm[pair[0]], self.touched_mm[pair[1]])))
            - side
            for pair, side in self.sides_mm.items()
        }
        return {pair: each for pair, each in off.items() if abs(each) > AGREE_MM}

    @property
    def accused(self) -> tuple[str, ...]:
        """The cups that were probably touched in the wrong place.

        It is the one cup that all disagreements share; if there is none, all that take part.
        """
        pairs = list(self.disagreements)
        if not pairs:
            return ()
        common = set(pairs[0]).intersection(*pairs) if len(pairs) > 1 else set()
        return tuple(name for name in self.corners if name in (common or set().union(*pairs)))

    @property
    def _touched(self) -> Array:
        return np.array([self.touched_mm[name] for name in self.corners])


def is_touch(cell: Cell, planned: PlannedReading) -> bool:
    """Check whether a person must jog a ball of the tool into a cup for this planned reading."""
    visit = planned.visit
    return visit.kind == "nest" and planned.target in cell.tool.targets and planned.base_target in cell.nests


def block_of_touches(store: RecordStore, cell: Cell) -> list[PlannedReading]:
    """Return the planned touches and sides of the first block with touches.

    Raises
    ------
    StorageError
        The record cannot be read.
    """
    plan = [planned for planned in store.plan() if planned.visit.kind == "nest"]
    first = min((each.visit.block for each in plan if is_touch(cell, each)), default=None)
    return [each for each in plan if each.visit.block == first]


def taught_of(store: RecordStore, cell: Cell) -> Taught | None:
    """Return the cups as touched last, or None before the first three are touched.

    The sides are those measured in the same block.

    Raises
    ------
    StorageError
        The record cannot be read.
    """
    of_block = {planned.id for planned in block_of_touches(store, cell)}
    rows = {row.base_target: row for row in touches_of(store) if row.counts and row.pose in of_block}
    touches = {name: rows[name] for name in cell.nests if name in rows}
    if not set(list(cell.nests)[:3]) <= set(touches):
        return None
    names = list(cell.tool.targets)
    joints = np.array([row.reached for row in touches.values()])
    places = targets_at(cell, joints)[range(len(touches)), [names.index(r.target) for r in touches.values()]]
    lengths: dict[Pair, list[float]] = {}
    readings, sides = [row.id for row in touches.values()], []
    corners = list(combinations(list(touches)[:3], 2))
    for row in spans_of(store):
        pair = next((two for two in corners if {row.target, row.base_target} == set(two)), None)
        if pair is not None and row.counts and row.length_mm is not None and row.pose in of_block:
            lengths.setdefault(pair, []).append(row.length_mm)
            readings.append(row.id)
            sides.append(row.pose)
    return Taught(
        {name: point(place) for name, place in zip(touches, places, strict=True)},
        {pair: float(np.mean(each)) for pair, each in lengths.items()},
        tuple(sorted(readings)),
        {name: row.pose for name, row in touches.items()},
        tuple(sides),
    )
