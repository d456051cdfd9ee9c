"""The quantity over which a place of structure is drawn: an angle, a load, a time, where gravity points on the tool."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from calib.arm import gravity_at_flange, gravity_torques
from calib.array import Array
from calib.data import Conditions, Header
from calib.diagnose import QUICK
from calib.units import DEG

_N_M = 1000.0  # N.mm


@dataclass(frozen=True)
class Quantity:
    """Values (n, q) of one, two or three quantities, what to call them, and (n,) groups of readings that differ."""

    values: Array
    labels: tuple[str, ...]
    group: NDArray[np.int64] | None = None
    group_names: tuple[str, ...] = ()


def quantity_of(where: str, conditions: Conditions, header: Header) -> Quantity | None:
    """What a place of structure is drawn over; None where it has more than three quantities, or no name we know."""
    if where.startswith("joint ") and where.endswith((" angle", " angles")):
        joints = [int(word) for word in where.split() if word.isdigit()]
        if not joints:  # all of them together
            return None
        values: Array = np.column_stack([conditions.joints[:, k - 1] for k in joints]) / DEG
        return Quantity(values, tuple(f"θ{k}, deg" for k in joints))
    if where in ("time", QUICK, "temperature"):
        return _in_time(where, conditions)
    if "down" in where:
        down = gravity_at_flange(header.robot, conditions.joints, header.gravity)
        labels = tuple(f"gravity along the flange's {axis}" for axis in "xyz")
        if not where.startswith("tool target"):
            return Quantity(down, labels)
        return Quantity(down, labels, conditions.target, conditions.target_names)
    if where.split()[-2:-1] == ["joint"] and where[-1].isdigit():
        return _of_joint(where, conditions, header)
    return None


def _in_time(where: str, conditions: Conditions) -> Quantity:
    if where == "time":
        return Quantity(conditions.time[:, None] / 3600.0, ("time, h",))
    if where == "temperature":
        return Quantity(conditions.temperature[:, None], ("air temperature, °C",))
    return Quantity(conditions.order[:, None] + 1.0, ("reading, in order of time",))


def _of_joint(where: str, conditions: Conditions, header: Header) -> Quantity | None:
    joint = int(where.split()[-1])
    k = joint - 1
    if where.startswith("torque about"):
        return Quantity(conditions.torque[:, [k]] / _N_M, ("torque, N.m",))
    if where.startswith("moment across"):
        size = np.linalg.norm(conditions.moment[:, k, :2], axis=1)
        return Quantity(size[:, None] / _N_M, ("moment across the joint, N.m",))
    if where.startswith("last move"):
        moved = conditions.joints[:, [k]] - conditions.previous[:, [k]]
        return Quantity(moved / DEG, ("last move, deg",))
    if where.startswith("last change of torque"):
        before = gravity_torques(header.robot, conditions.previous, header.loads, header.gravity)
        change = conditions.torque[:, [k]] - before[:, [k]]
        return Quantity(change / _N_M, ("change of torque in the last move, N.m",))
    if where.startswith("side of approach"):
        side = (conditions.side[:, k] > 0).astype(np.int64)
        return Quantity(
            conditions.joints[:, [k]] / DEG,
            (f"θ{joint}, deg",),
            side,
            ("arrived from above", "arrived from below"),
        )
    return None
