"""Second implementation of the kinematic chain, by 4x4 matrices and plain loops.

It is slow and takes complex numbers, with which a derivative is exact to the last digit: f'(x) = Im f(x + ih) / h.
It shares no line with the chain under test.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from calib.arm.robot import Robot

Matrix = NDArray[np.complex128]


def turn(axis: str, angle: Any) -> Matrix:
    """Rotation about x, y or z, (4, 4)."""
    c, s = np.cos(angle), np.sin(angle)
    i, j = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
    out = np.eye(4, dtype=complex)
    out[i, i], out[j, j], out[i, j], out[j, i] = c, c, -s, s
    return out


def shift(axis: str, length: Any) -> Matrix:
    """Translation along x, y or z, (4, 4)."""
    out = np.eye(4, dtype=complex)
    out["xyz".index(axis), 3] = length
    return out


def six(values: Mapping[str, Any], name: str, between: Matrix | None = None) -> Matrix:
    """Tx Ty Tz (`between`) Rx Ry Rz."""
    out = np.eye(4, dtype=complex)
    for axis in "xyz":
        out = out @ shift(axis, values.get(f"{name}.{axis}", 0.0))
    out = out if between is None else out @ between
    for axis in "xyz":
        out = out @ turn(axis, values.get(f"{name}.r{axis}", 0.0))
    return out


def chain(
    robot: Robot, joints: Any, add: Mapping[str, Any], target: Any = (0.0, 0.0, 0.0), station: Any = (0, 0, 0)
) -> Matrix:
    """Compute the frame of the target in the world, (4, 4).

    The model joints (N,) are in rad or mm; `add` is added to the slots.
    """
    about = shift("x", station[0]) @ shift("y", station[1]) @ shift("z", station[2])
    frame = about @ six(add, "frame") @ np.linalg.inv(about)
    thesis = robot.base == "thesis"
    d1 = robot.d[0] + add.get("d1", 0.0)
    frame = frame @ six(add, "base", shift("z", d1) if thesis else None)
    for k in range(1, robot.joints + 1):
        alpha = turn("x", robot.alpha[k - 1] + add.get(f"alpha{k}", 0.0))
        beta = turn("y", add.get(f"beta{k}", 0.0))
        a = shift("x", robot.a[k - 1] + add.get(f"a{k}", 0.0))
        slides = k in robot.slides
        theta = turn("z", robot.theta[k - 1] + (0.0 if slides else joints[k - 1]) + add.get(f"theta{k}", 0.0))
        d = shift("z", 0.0 if thesis and k == 1 else robot.d[k - 1] + add.get(f"d{k}", 0.0))
        if slides:  # a carriage on the axis, which goes aside, tilts and rolls where it stands
            aside = shift("x", add.get(f"bearing{k}.x", 0.0)) @ shift("y", add.get(f"bearing{k}.y", 0.0))
            d = d @ shift("z", joints[k - 1]) @ aside
        tilt = turn("x", add.get(f"bearing{k}.rx", 0.0)) @ turn("y", add.get(f"bearing{k}.ry", 0.0))
        if slides:
            carriage = d @ tilt @ theta
            mdh = robot.convention == "mdh"
            frame = frame @ (alpha @ beta @ a @ carriage if mdh else carriage @ a @ alpha @ beta)
        elif (
            robot.convention == "mdh"
        ):  # the bearing tilts about the origin of frame K, in axes that do not turn yet
            frame = frame @ alpha @ beta @ a @ d @ tilt @ np.linalg.inv(d) @ theta @ d
        else:
            frame = frame @ tilt @ theta @ d @ a @ alpha @ beta
    frame = frame @ six(add, "tool")
    for axis, length in zip("xyz", target, strict=True):
        frame = frame @ shift(axis, length + add.get(f"target.{axis}", 0.0))
    for axis in "xyz":
        frame = frame @ turn(axis, add.get(f"target.r{axis}", 0.0))
    return frame
