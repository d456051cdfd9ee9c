"""Data sets that cannot be fitted: too few readings, no noise, joints beyond limits.

They are refused with file, line and column.
"""

from __future__ import annotations

import numpy as np

from calib.data.dataset import Dataset
from calib.data.header import LEAST
from calib.data.hypotheses import reach
from calib.errors import DataError
from calib.text.columns import TextTable

_FEWEST_A_SERIES = 3
_STILL = 3e-4  # share of the reach within which an instrument that is stuck gives its readings
_BEYOND = 2.0  # deg or mm, by which a joint may exceed its limit: limits are set a little apart in many a controller


def refuse_beyond_limits(dataset: Dataset, table: TextTable) -> None:
    """Raise DataError for joints beyond the limits: a typing error, or another robot."""
    robot, conditions = dataset.header.robot, dataset.conditions
    units = robot.joint_units
    shown = robot.controller_angles(conditions.joints, dataset.header.coupling) / units
    lower, upper = np.array(robot.lower) / units, np.array(robot.upper) / units
    beyond = (shown < lower - _BEYOND) | (shown > upper + _BEYOND)
    for i, k in np.argwhere(beyond & dataset.usable[:, None])[:1]:
        raise table.refuse(
            int(i),
            robot.joint_columns[k],
            f"is {shown[i, k]:g}, and joint {robot.axes[k].removeprefix('j')} of {robot.name} goes from "
            f"{lower[k]:g} to {upper[k]:g} {robot.units[k]}",
            "Correct it, or write beyond_limits = true in the header where the robot really went there",
        )


def refuse_unfit(dataset: Dataset, table: TextTable) -> None:
    """Raise DataError if the readings cannot carry their model, or not even place the robot.

    `dataset` is the one from which the robot is placed. If nothing is to be fitted, it consists of its
    validation rows.
    """
    rows = dataset.fit_rows
    if not rows.any():
        raise DataError(
            "has no measured row, neither for a fit nor for judging a model.",
            do="Measure, or take back the status of rows that were rejected without need.",
            file=table.path,
            key="set",
        )
    pointed = dataset.points[rows & dataset.pointed]
    if len(np.unique(dataset.conditions.joints[rows], axis=0)) == 1 or (
        len(pointed) == int(rows.sum())
        and np.ptp(pointed, axis=0).max() < _STILL * reach(dataset.header.robot)
    ):
        raise DataError(
            "all calibration readings are the same.",
            do="Measure poses all over the joint ranges.",
            file=table.path,
            key=f"{dataset.header.robot.joint_columns[0]}.. x_mm..",
        )
    conditions = dataset.conditions
    for s, name in enumerate(conditions.series_names):
        few = int(rows[conditions.series == s].sum())
        if few < _FEWEST_A_SERIES:
            raise DataError(
                f"series '{name}' has {few} calibration readings, too few to locate its base.",
                do=f"Measure {_FEWEST_A_SERIES} or more with set = calibration, or leave the series out.",
                file=table.path,
                key="set",
            )
    if "tool" in dataset.header.groups:
        pairs = {
            (int(s), int(t)) for s, t in zip(conditions.series[rows], conditions.target[rows], strict=True)
        }
        for i, pair in enumerate(zip(conditions.series, conditions.target, strict=True)):
            if (int(pair[0]), int(pair[1])) not in pairs:
                raise table.refuse(
                    i,
                    "tool_target",
                    f"names {conditions.target_names[pair[1]]}, which no calibration reading measured",
                    "With 'tool' under [model] fit every target needs calibration readings of its series",
                )
    given = np.isfinite(dataset.u_point)
    for i in np.flatnonzero(given.any(axis=1) & ~(given & (dataset.u_point >= LEAST)).all(axis=1)):
        raise table.refuse(
            int(i),
            "u_x_mm, u_y_mm, u_z_mm",
            "are not all above zero",
            "Give all three, or none for [noise] to hold",
        )
    if dataset.header.noise.kind == "per-row":
        pointed_rows = dataset.usable & dataset.pointed
        for i in np.flatnonzero(pointed_rows & ~np.all(dataset.u_point >= LEAST, axis=1)):
            raise table.refuse(
                int(i),
                "u_x_mm",
                "is empty or zero, and [noise] kind is 'per-row'",
                "Give u_x_mm, u_y_mm, u_z_mm",
            )
    _refuse_without_noise(dataset, table)


def _refuse_without_noise(dataset: Dataset, table: TextTable) -> None:
    """Refuse distances without noise: they weigh by it, and it cannot be guessed."""
    for of_row, column in ((dataset.u_rotation, "u_rot_mrad"), (dataset.u_length, "u_length_mm")):
        for i in np.flatnonzero(np.isfinite(of_row) & ~(of_row >= LEAST * 1e-3)):
            raise table.refuse(int(i), column, "is not above zero", "Leave it empty for [noise] to hold")
    missing = np.flatnonzero(dataset.usable & dataset.spanned & ~np.isfinite(dataset.u_length))
    if dataset.header.noise.length_mm == 0.0 and len(missing):
        raise DataError(
            f"is missing or zero, but line {table.lines[int(missing[0])]} of {dataset.path.name} holds a distance.",
            do="Give its standard uncertainty under [noise], or fill the column u_length_mm.",
            file=dataset.path.with_suffix(".toml"),
            key="noise.length_mm",
        )
