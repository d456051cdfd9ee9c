"""A handful of readings with which a robot file is checked: joints, points, and the measured tool targets.

A data set has a header beside it; of it only the tool targets and the joint matrix are taken, since nothing else
matters before a fit. Without a header, or where it frees the tool, they are unknown and come out of the readings.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm import Robot
from calib.array import Array
from calib.data import FEWEST_MEANT, Meaning
from calib.errors import DataError
from calib.text import Columns, TomlTable, read_toml

_POINT = ("x_mm", "y_mm", "z_mm")
_MOST = 300
_ACCEPTED = ("", "ok")


@dataclass(frozen=True)
class Handful:
    """meaning: the readings as the files have them; rows: (n,) usable rows of everything; tools: (T, 3) mm."""

    everything: Meaning
    rows: NDArray[np.int64]
    usable: NDArray[np.bool_]
    tools: Array
    tool_unknown: bool

    @property
    def meaning(self) -> Meaning:
        """The usable readings."""
        whole, rows = self.everything, self.rows
        assert whole.points is not None
        return Meaning(whole.robot, whole.coupling, whole.angles[rows], whole.which[rows], whole.points[rows])


def read_handful(robot: Robot, data: Path, coupling: str | None = None) -> Handful:
    """The readings of DATA.csv, as `robot` counts its joints. Raises DataError naming column or key."""
    table = Columns.read(data)
    for name in (*robot.joint_columns, *_POINT):
        table.require(name, "A check needs the joints of the robot file and a measured point in every row.")
    header = _header(data.with_suffix(".toml"))
    coupling = coupling or ("none" if header is None else header.text("joint_coupling", "none"))
    if coupling != "none" and coupling not in robot.joint_matrices:
        raise DataError(
            f"is '{coupling}', which the robot file does not have.",
            do=f"Use one of {', '.join(('none', *robot.joint_matrices))}.",
            file=data.with_suffix(".toml"),
            key="joint_coupling",
        )
    names, which = np.unique(table.text("tool_target", "T1"), return_inverse=True)
    known = {} if header is None else header.vectors("tool_targets")
    listed = [str(name) for name in names]
    if header is not None and len(known) == 1 and listed == ["T1"]:
        listed = list(known)  # the only one of the header needs no column
    points = np.column_stack([table.numbers(name) for name in _POINT])
    angles = np.column_stack([table.numbers(name) for name in robot.joint_columns]) * robot.joint_units
    usable = np.isfinite(points).all(axis=1) & np.isfinite(angles).all(axis=1)
    usable &= np.isin(table.text("status"), _ACCEPTED)
    usable &= table.text("series", "main") == table.text("series", "main")[0]
    rows = np.flatnonzero(usable)
    if len(rows) < FEWEST_MEANT:
        raise DataError(
            f"has {len(rows)} readings of one series with joints and a point.",
            do=f"Give {FEWEST_MEANT} or more; 20 over the whole range of every joint are a good number.",
            file=data,
        )
    fitted = header is not None and "tool" in (header.table("model").names("fit") or ())
    return Handful(
        everything=Meaning(robot, coupling, angles, which.astype(np.int64), points),
        rows=rows[:: -(-len(rows) // _MOST)],
        usable=usable,
        tools=np.array([known.get(name, (0.0, 0.0, 0.0)) for name in listed]),
        tool_unknown=fitted or not all(name in known for name in listed),
    )


def _header(path: Path) -> TomlTable | None:
    return TomlTable(read_toml(path)[1], path) if path.is_file() else None
