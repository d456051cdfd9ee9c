"""Checks that the instrument measured the requested target, and measured it again.

A tracker that locked on the neighbouring SMR, an SMR in the wrong nest, and a body under another's name all give good
readings of the wrong object. The nominal robot gives the place of the target: it is off by millimetres, and targets are
centimetres apart.
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
    """The expected places of the cell's targets at the joints of the robot, deg.

    The places (m, 3) are in mm, in the world frame.
    """

    def __init__(self, cell: Cell, planned: PlannedReading, joints_deg: Sequence[float]) -> None:
        self._cell = cell
        self._target = planned.target
        self._names = list(cell.tool.targets)
        self._targets_mm = targets_at(cell, np.array([joints_deg]))[0]

    @property
    def world_mm(self) -> Array:
        """The expected place of the target to be measured, shape (3,)."""
        return self._targets_mm[self._names.index(self._target)]

    def refuse_another(self, reading: PointReading, world_mm: Array) -> None:
        """Check the place of a point (3,).

        Raises
        ------
        WronglySeated
            It is not the target, and a person seats the only SMR.
        Misplaced
            It is not the target.
        """
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
    """A check for a bridge that sends its last point again.

    A target that has moved never reads the same to the last digit. Without this check, a bridge that repeats a point
    with a new time would not be noticed if the steps are small.
    """

    def __init__(self) -> None:
        self._last: dict[str, tuple[tuple[float, float, float], Array]] = {}  # of each target
        self._last_length: tuple[float, tuple[object, ...]] | None = None

    def refuse_repeated_point(self, reading: PointReading, expected_mm: Array) -> None:
        """Refuse a reading that repeats the last point of a target that has moved.

        `expected_mm` (3,) is the expected place of the target in the world frame.

        Raises
        ------
        NothingNew
            The point equals the last one, but the target should have moved.
        """
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
        """Refuse a length that repeats the sensor reading of another leg or pose.

        Two legs, or one in two poses, have different sensor readings. Sides of a triangle may have equal lengths; they
        are compared with their first reading (`BallbarChecks.moved`).

        Raises
        ------
        NothingNew
            The sensor shows the same value to the last digit.
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
    """Convert a point (3,) to the joints that were planned, according to the nominal robot.

    It was measured at other joints, `stands_deg`.
    """
    if tuple(stands_deg) == tuple(planned.visit.joints_deg):
        return world_mm.tolist()
    there, here = (Expectation(cell, planned, q) for q in (planned.visit.joints_deg, stands_deg))
    return (world_mm + there.world_mm - here.world_mm).tolist()
