"""Readings of foreign files by their map: joints, points, orientations and names of every row, in the program's units.

Points of a second file are matched to the joints by name, by order or by time, as the map says.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import Robot
from calib.array import Array
from calib.errors import DataError
from calib.units import DEG


@dataclass(frozen=True)
class Readings:
    """n readings. joints (n, N) by `axes` (`j1`, `e1`), in rad, or mm where `units` says `mm`; points (n, 3) mm,
    NaN where not measured; turns (n, 4) quaternions, scalar first, or NaN; texts: quantity -> (n,) names; numbers:
    further quantities (n,); rejected: (n,) why a reading does not count, or ''."""

    joints: Array
    axes: tuple[str, ...]
    units: tuple[str, ...]
    points: Array
    turns: Array
    texts: Mapping[str, tuple[str, ...]]
    numbers: Mapping[str, Array]
    rejected: tuple[str, ...]

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def joint_columns(self) -> tuple[str, ...]:
        """The columns of the joints in a data set: `j1_deg`, `e1_mm`."""
        return tuple(f"{axis}_{unit}" for axis, unit in zip(self.axes, self.units, strict=True))

    @property
    def shown_joints(self) -> Array:
        """(n, N) joints in deg or mm."""
        return self.joints / np.array([1.0 if unit == "mm" else DEG for unit in self.units])

    def take(self, rows: NDArray[np.int64]) -> Readings:
        """Some of the readings, by index; one may be taken several times."""
        return replace(
            self,
            joints=self.joints[rows],
            points=self.points[rows],
            turns=self.turns[rows],
            texts={key: tuple(cells[i] for i in rows) for key, cells in self.texts.items()},
            numbers={key: values[rows] for key, values in self.numbers.items()},
            rejected=tuple(self.rejected[i] for i in rows),
        )

    def of_robot(self, robot: Robot, file: Path | str) -> Readings:
        """The readings with their joints in the order of the robot's. Raises DataError where they are not its
        joints."""
        if sorted(self.joint_columns) != sorted(robot.joint_columns):
            raise DataError(
                f"has the joints {', '.join(self.joint_columns)}, and {robot.name} has "
                f"{', '.join(robot.joint_columns)}.",
                do="Correct the robot, or the columns of the map and their units.",
                file=file,
            )
        order = [self.joint_columns.index(name) for name in robot.joint_columns]
        return replace(self, joints=self.joints[:, order], axes=robot.axes, units=robot.units)


def joined(
    joints: Readings,
    points: Readings,
    rows: tuple[NDArray[np.int64], NDArray[np.int64]],
    targets: tuple[str, ...] | None,
) -> Readings:
    """Readings of two files, of which `rows` belong together. targets: (n,) from the names of the points."""
    joints, points = joints.take(rows[0]), points.take(rows[1])
    texts = {**joints.texts, **points.texts}
    if "pose" in joints.texts:
        texts["pose"] = joints.texts["pose"]
    if targets is not None:
        texts["target"] = targets
    return replace(
        joints,
        points=points.points,
        turns=points.turns,
        texts=texts,
        numbers={**joints.numbers, **points.numbers},
        rejected=tuple(a or b for a, b in zip(joints.rejected, points.rejected, strict=True)),
    )
