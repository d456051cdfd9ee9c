"""Readings of foreign files in the program's units, and the data set made from them.

Points of a second file are matched to the joints by name, by order or by time, as the map states. The
data set has columns with units in their names, and the header that the map holds.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import tomli_w
from numpy.typing import NDArray

from calib.arm.robot import Robot
from calib.array import Array
from calib.convert.table import ConvertedTable
from calib.errors import DataError
from calib.foreign.map.map_file import Map
from calib.units import DEG

_PLAIN = ("series", "set", "waypoint", "visit")


@dataclass(frozen=True)
class ForeignReadings:
    """n readings of foreign files.

    Attributes
    ----------
    joints : array of shape (n, N)
        Joints by `axes`, rad, or mm if `units` states `mm`.
    axes : tuple of str
        Names such as `j1`, `e1`.
    points : array of shape (n, 3)
        Points, mm; NaN if not measured.
    turns : array of shape (n, 4)
        Quaternions, scalar first; NaN if not measured.
    texts : mapping of str to tuple of str
        Names by quantity, n each.
    numbers : mapping of str to array of shape (n,)
        Further quantities.
    rejected : tuple of str
        Why each reading does not count, or ''.
    coupling : str
        Joint matrix by which the joints are counted.
    """

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
        """Joints in deg or mm, shape (n, N)."""
        return self.joints / np.array([1.0 if unit == "mm" else DEG for unit in self.units])

    def take(self, rows: NDArray[np.int64]) -> ForeignReadings:
        """Select readings by index; one may be taken several times."""
        return replace(
            self,
            joints=self.joints[rows],
            points=self.points[rows],
            turns=self.turns[rows],
            texts={key: tuple(cells[i] for i in rows) for key, cells in self.texts.items()},
            numbers={key: values[rows] for key, values in self.numbers.items()},
            rejected=tuple(self.rejected[i] for i in rows),
        )

    def of_robot(self, robot: Robot, file: Path | str) -> ForeignReadings:
        """Put the joints in the order of the robot's.

        Raises
        ------
        DataError
            They are not the joints of this robot.
        """
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

    def _with_followers(self, robot: Robot) -> ForeignReadings | None:
        """Add the joints that follow others; the files may lack some of them.

        Returns None if other joints are missing. Joints that were numbered without the followers are
        renumbered.
        """
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
                apart = np.array([columns[names[k]], columns[names[k]] - follow[:, k]])
                joints[:, k] = apart[np.argmin(np.abs(apart).max(axis=1, initial=0.0))]
        return replace(read, joints=joints, axes=robot.axes, units=robot.units, coupling=robot.rods)


def _renumbered(key: str, axes: Mapping[str, str]) -> str:
    """Rename the quantity of a joint (`read3`, `prev3`) by the robot's number of the joint."""
    match = re.fullmatch(r"(read|prev|approach)(\d+)", key)
    return key if match is None else f"{match[1]}{axes.get(f'j{match[2]}', match[2]).removeprefix('j')}"


def joined(
    joints: ForeignReadings,
    points: ForeignReadings,
    rows: tuple[NDArray[np.int64], NDArray[np.int64]],
    targets: tuple[str, ...] | None,
) -> ForeignReadings:
    """Join the readings of two files, of which `rows` belong together.

    `targets` (n,) come from the names of the points.
    """
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


def table_of(readings: ForeignReadings, made: Map, map_path: Path | str, source: str) -> ConvertedTable:
    """Convert readings to the columns and the header of a data set.

    `source` names the files in the first line of the header.
    """
    n = len(readings)
    ids = readings.texts.get("id", ())
    unique = len(set(ids)) == n and all(ids)
    columns: dict[str, list[str]] = {"reading_id": list(ids) if unique else [str(i + 1) for i in range(n)]}
    for key in _PLAIN:
        if key in readings.texts:
            columns[key] = list(readings.texts[key])
    if "time" in readings.numbers:
        time = readings.numbers["time"]
        columns["t_s"] = _text(time - np.nanmin(time), 3)
    for name, values in zip(readings.joint_columns, readings.shown_joints.T, strict=True):
        columns[name] = _text(values, 6)
    units = dict(zip(readings.axes, readings.units, strict=True))
    for quantity, values in readings.numbers.items():
        if quantity.startswith(("read", "prev")):
            kind, axis = quantity[:4], quantity[4:]
            unit = units.get(f"j{axis}", "deg")
            name = f"j{axis}_read_{unit}" if kind == "read" else f"prev{axis}_{unit}"
            columns[name] = _text(values if unit == "mm" else values / DEG, 6)
        elif quantity.startswith("approach"):
            columns[quantity] = _text(values, 0)
    if "target" in readings.texts:
        columns["tool_target"] = list(readings.texts["target"])
    for k, axis in enumerate("xyz"):
        columns[f"{axis}_mm"] = _text(readings.points[:, k], 6)
    if np.isfinite(readings.turns).any():
        turned = np.isfinite(readings.points).all(axis=1)
        for k, part in enumerate("wxyz"):
            columns[f"rot_{part}"] = _text(np.where(turned, readings.turns[:, k], np.nan), 9)
    if "t_air" in readings.numbers:
        columns["t_air_c"] = _text(readings.numbers["t_air"], 4)
    if "pose" in readings.texts:
        columns["pose"] = list(readings.texts["pose"])
    if any(readings.rejected):
        columns["status"] = [why or "ok" for why in readings.rejected]
    header = _header(made.header, readings, map_path)
    return ConvertedTable(
        columns, f"# converted from {json.dumps(source, ensure_ascii=False)}\n{tomli_w.dumps(header)}"
    )


def _header(header: Mapping[str, Any], readings: ForeignReadings, map_path: Path | str) -> dict[str, Any]:
    """Add a target for every measured name to the header of the map."""
    out = {
        key: value for key, value in header.items() if key != "holdout"
    }  # what was held out is written after it
    if readings.coupling != "none":
        out.setdefault("joint_coupling", readings.coupling)
    known = dict(out.get("tool_targets", {}))
    new = [name for name in dict.fromkeys(readings.texts.get("target", ())) if name and name not in known]
    if new and "tool" not in out.get("model", {}).get("fit", []):
        raise DataError(
            f"has no position of the targets {', '.join(new)}, and does not fit the tool.",
            do='Give each under [header.tool_targets], or add "tool" to fit under [header.model].',
            file=map_path,
            key="header.tool_targets",
        )
    out["tool_targets"] = known | {name: [0.0, 0.0, 0.0] for name in new}
    return out


def _text(values: Any, decimals: int) -> list[str]:
    return ["" if not np.isfinite(value) else f"{value:.{decimals}f}" for value in values]
