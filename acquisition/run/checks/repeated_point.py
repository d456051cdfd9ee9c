"""The check that the instrument saw the target asked for, by its place, which the nominal robot gives.

A tracker that locked on the neighbouring SMR, an SMR in the wrong nest and a body under another's name all answer
with good readings of the wrong thing. The nominal robot is off by millimetres, targets are centimetres apart.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from acquisition.cell.cell import Cell
from acquisition.cell.workspace import Array, targets_at
from acquisition.errors import Misplaced, NothingNew, WronglySeated
from acquisition.record.store import PlannedReading
from drivers.interfaces import LengthReading, PointReading

_SURELY_MOVED_MM = 0.5  # by the nominal robot, which knows a step of some millimetres to a hundredth


class Expectation:
    """The expected places of the cell's targets where the robot stands, deg; `targets_mm` (m, 3), world."""

    def __init__(self, cell: Cell, planned: PlannedReading, joints_deg: Sequence[float]) -> None:
        self._cell = cell
        self._target = planned.target
        self._names = list(cell.tool.targets)
        self._targets_mm = targets_at(cell, np.array([joints_deg]))[0]

    @property
    def world_mm(self) -> Array:
        """(3,) the target that is to be measured."""
        return self._targets_mm[self._names.index(self._target)]

    def refuse_another(self, reading: PointReading, world_mm: Array) -> None:
        """Check the place of a point (3,). Raises Misplaced; WronglySeated where a person seats the SMR."""
        off = np.linalg.norm(self._targets_mm - world_mm, axis=1)
        from_target = float(off[self._names.index(self._target)])
        limit = self._cell.instrument.expected_within_mm
        if from_target <= limit:
            return
        nearest = int(np.argmin(off))
        hint = (
            f"; {self._names[nearest]} should be {off[nearest]:.1f} mm from there"
            if off[nearest] <= limit
            else ""
        )
        kind = WronglySeated if self._cell.instrument.one_smr else Misplaced
        raise kind(
            f"the instrument sees {self._target} {from_target:.1f} mm from where it should be, "
            f"expected within {limit:g} mm{hint}",
            device="instrument",
            command=f"measure {self._target}",
            raw=reading.raw,
        )


class RepeatedPointCheck:
    """The check that the instrument measured anew: a target that has moved is never seen in the same place to the last
    digit. A bridge that sends its last point again under a new time would go unseen where steps are small."""

    def __init__(self) -> None:
        self._last: dict[str, tuple[tuple[float, float, float], Array]] = {}  # of each target
        self._last_length: tuple[float, tuple[object, ...]] | None = None

    def refuse_again(self, reading: PointReading, expected_mm: Array) -> None:
        """`expected_mm` (3,), world: where the target should be. Raises NothingNew."""
        last_mm, last_expected_mm = self._last.get(reading.target, (None, expected_mm))
        if reading.xyz_mm == last_mm:
            moved_mm = float(np.linalg.norm(expected_mm - last_expected_mm))
            if moved_mm > _SURELY_MOVED_MM:
                raise NothingNew(
                    f"the same point to the last digit as before, though it should be {moved_mm:.1f} mm from there",
                    device="instrument",
                    command="measure",
                    raw=reading.raw,
                )
        self._last[reading.target] = reading.xyz_mm, expected_mm

    def refuse_length_again(self, reading: LengthReading, planned: PlannedReading) -> None:
        """Two legs, or one in two poses, show the sensor at different places. Raises NothingNew.

        Sides of a triangle may be made alike, and are held against what they were (`BallbarChecks.moved`).
        """
        if planned.visit.between_balls:
            return
        leg = (planned.visit.joints_deg, reading.target, reading.base_target)
        last = self._last_length
        if last is not None and last[0] == reading.deviation_mm and last[1] != leg:
            raise NothingNew(
                f"the sensor shows {reading.deviation_mm:+.4f} mm to the last digit as in the distance before",
                device="instrument",
                command="measure",
                raw=reading.raw,
            )
        self._last_length = reading.deviation_mm, leg


def as_planned(
    cell: Cell, planned: PlannedReading, stands_deg: Sequence[float], world_mm: Array
) -> list[float]:
    """(3,) a point as it would be at the joints that were planned, by the nominal robot; it stands at others."""
    if tuple(stands_deg) == tuple(planned.visit.joints_deg):
        return world_mm.tolist()
    there, here = (Expectation(cell, planned, q) for q in (planned.visit.joints_deg, stands_deg))
    return (world_mm + there.world_mm - here.world_mm).tolist()
