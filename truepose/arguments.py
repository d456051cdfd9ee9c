"""Checks of arguments: arrays of joint angles in degrees, single numbers, and models."""

from __future__ import annotations

import math
import warnings
from numbers import Real
from typing import Any

import numpy as np

from calib.array import Array
from calib.data import LEVELS
from calib.errors import DataError
from calib.saved import CalibratedModel

_MANY = 5  # targets, within so small angles that they look like radians


def joints_of(joints_deg: Any, saved: CalibratedModel) -> Array:
    """Return model joints (n, N), rad or mm, of joints as the controller counts them.

    The argument is an array or a DataFrame, deg or mm. Degrees that look like radians cause a warning.

    Raises
    ------
    DataError
        The shape is wrong, or a number is not finite.
    """
    robot = saved.model.robot
    if hasattr(joints_deg, "columns"):
        names = list(robot.joint_columns)
        missing = [name for name in names if name not in joints_deg.columns]
        if missing:
            raise DataError(
                f"column '{missing[0]}' is missing.", do=f"Give {', '.join(names)}.", key="joints_deg"
            )
        joints_deg = joints_deg[names].to_numpy()
    try:
        angles = np.asarray(joints_deg, dtype=np.float64)
    except (TypeError, ValueError) as error:  # words, or rows of different lengths
        raise DataError(
            f"is not an array of numbers: {error}.", do=f"Give (n, {robot.joints}) angles.", key="joints_deg"
        ) from error
    if angles.ndim == 1:
        angles = angles[None]
    if angles.ndim != 2 or angles.shape[1] != robot.joints:
        raise DataError(
            f"has the shape {angles.shape}.", do=f"Give (n, {robot.joints}) angles.", key="joints_deg"
        )
    if not np.all(np.isfinite(angles)):
        raise DataError("holds numbers that are not finite.", do="Leave those rows out.", key="joints_deg")
    turning = angles[:, [kind == "turns" for kind in robot.kinds]]
    if len(angles) >= _MANY and np.any(turning) and np.max(np.abs(turning)) <= math.pi:
        warnings.warn("joints_deg: all angles lie within 3.15 deg. Are they radians?", stacklevel=3)
    return robot.model_angles(angles * robot.joint_units, saved.coupling)


def number_of(value: float | None, usual: float, low: float, high: float, key: str) -> float:
    """Return a number, or the usual one if it is None.

    Raises
    ------
    DataError
        It is no number, or not between `low` and `high`.
    """
    if value is None:
        return usual
    if not isinstance(value, Real):
        raise DataError(
            f"is {type(value).__name__}, not a number.",
            do=f"Give a number from {low:g} to {high:g}.",
            key=key,
        )
    if not low <= value <= high:
        raise DataError(f"is {value:g}.", do=f"Give a number from {low:g} to {high:g}.", key=key)
    return float(value)


def refuse_no_model(model: object, wanted: type, key: str = "model") -> None:
    """Refuse anything but a model, such as the name of its file.

    Raises
    ------
    DataError
        It is no model.
    """
    if not isinstance(model, wanted):
        raise DataError(
            f"is {type(model).__name__}, not a model.",
            do="Give truepose.load(file) or identify(data).",
            key=key,
        )


def refuse_other_level(level: int | None) -> None:
    """Refuse a level of calibration that does not exist; None stands for what the header frees.

    Raises
    ------
    DataError
        There is no such level.
    """
    if level is not None and level not in LEVELS:
        raise DataError(f"is {level}.", do="Use 1, 2 or 3.", key="level")


def angles_of(joints: Array, saved: CalibratedModel) -> Array:
    """Return joints (n, N) as the controller counts them, deg or mm, of model joints, rad or mm."""
    robot = saved.model.robot
    return robot.controller_angles(joints, saved.coupling) / robot.joint_units
