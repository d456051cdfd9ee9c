"""Readings of foreign files by their map: joints, points, orientations and names of every row, in the program's units.

Points of a second file are matched to the joints by name, by order or by time, as the map says.
"""

from __future__ import annotations

import re
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
    further quantities (n,); rejected: (n,) why a reading does not count, or ''; coupling: how
    joints are counted."""

    joints: Array
    axes: tuple[str, ...]
    units: tuple[str, ...]
    points: Array
    turns: Array
    texts: Mapping[str, tuple[str, ...]]
    numbers: Mapping[str, Array]
    rejected: tuple[str, ...]
    coupling: str = "none"

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
        if robot.rods != "none" and (whole := self._with_followers(robot)) is not None:
            return whole
        if sorted(self.joint_columns) != sorted(robot.joint_columns):
            raise DataError(
                f"has the joints {', '.join(self.joint_columns)}, and {robot.name} has "
                f"{', '.join(robot.joint_columns)}.",
                do="Correct the robot, or the columns of the map and their units.",
                file=file,
            )
        order = [self.joint_columns.index(name) for name in robot.joint_columns]
        return replace(self, joints=self.joints[:, order], axes=robot.axes, units=robot.units)

    def _with_followers(self, robot: Robot) -> Readings | None:
        """The readings with the joints that follow others, some of which the files do not hold; None where other
        joints are missing. Joints numbered without them are numbered anew."""
        followers = robot.followers(robot.rods)
        own = [k for k in range(robot.joints) if k not in followers]
        read, of = self, self.axes
        turned = [k for k in own if robot.axes[k].startswith("j")]
        new = {axis: axis for axis in robot.axes} | {
            f"j{i}": robot.axes[k] for i, k in enumerate(turned, start=1)
        }
        if set(of) == {f"j{i}" for i in range(1, len(turned) + 1)} | {
            robot.axes[k] for k in own if k not in turned
        }:
            numbers = {_renumbered(key, new): values for key, values in self.numbers.items()}
            read = replace(self, axes=tuple(new[axis] for axis in self.axes), numbers=numbers)
        columns = dict(zip(read.joint_columns, read.joints.T, strict=True))
        names = robot.joint_columns
        if not set(columns) <= set(names) or not {names[k] for k in own} <= set(columns):
            return None
        joints = np.zeros((len(self), robot.joints))
        for k in own:
            joints[:, k] = columns[names[k]]
        follow = robot.model_angles(joints, robot.rods)
        for k in (
            followers
        ):  # one may be there: where it stands, or only what it differs by from where it follows to
            if names[k] in columns:
                apart = columns[names[k]], columns[names[k]] - follow[:, k]
                joints[:, k] = min(apart, key=lambda values: float(np.abs(values).max(initial=0.0)))
        return replace(read, joints=joints, axes=robot.axes, units=robot.units, coupling=robot.rods)


def _renumbered(key: str, axes: Mapping[str, str]) -> str:
    """The quantity of a joint (`read3`, `prev3`) under the number that the robot has for it."""
    match = re.fullmatch(r"(read|prev|approach)(\d+)", key)
    return key if match is None else f"{match[1]}{axes.get(f'j{match[2]}', match[2]).removeprefix('j')}"


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
