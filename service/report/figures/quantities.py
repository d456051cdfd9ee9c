"""Quantities over which structure is drawn, such as an angle, a load or a time."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.arm import Robot, forward, gravity_at_flange, gravity_torques
from calib.array import Array
from calib.data import Conditions, Header
from calib.diagnose import QUICK, TOGETHER, pauses
from calib.model import Axis
from calib.units import DEG

_N_M = 1000.0  # N.mm
_PAUSE = "time since the last move"


@dataclass(frozen=True)
class Quantity:
    """Values (n, q) of one or several quantities.

    They have labels, and (n,) groups of readings that differ.
    """

    values: Array
    labels: tuple[str, ...]
    group: NDArray[np.int64] | None = None
    group_names: tuple[str, ...] = ()


def quantity_of(where: str, conditions: Conditions, header: Header) -> Quantity | None:
    """Return the quantity over which a place of structure is drawn; None if its name is unknown."""
    if where == TOGETHER:
        moving = [k for k in range(conditions.joints.shape[1]) if np.ptp(conditions.joints[:, k]) > 0.0]
        return _over(moving, conditions)
    links = _links(where, header.robot)
    if where.startswith("joint ") and where.endswith((" angle", " angles")):
        return _over(links, conditions)
    if where in ("time", _PAUSE, QUICK, "temperature"):
        return _in_time(where, conditions)
    if "down" in where:
        down = gravity_at_flange(header.robot, conditions.joints, header.gravity)
        labels = tuple(f"gravity along the flange's {axis}" for axis in "xyz")
        if not where.startswith("tool target"):
            return Quantity(down, labels)
        return Quantity(down, labels, conditions.target, conditions.target_names)
    if where in _VECTORS:
        return _VECTORS[where](conditions, header)
    if where.split()[-2:-1] == ["joint"] and links:
        return _of_joint(where, links[-1], conditions, header)
    return None


def _links(where: str, robot: Robot) -> list[int]:
    """Return the indices of the joints that a place names: "joint 3 and joint e1 angles"."""
    index = {axis.removeprefix("j"): k for k, axis in enumerate(robot.axes)}
    return [index[word] for word in where.split() if word in index]


def _over(joints: list[int], conditions: Conditions) -> Quantity:
    """Return the places of some joints, deg or mm."""
    axes = [Axis.angle(k + 1, conditions) for k in joints]
    return Quantity(np.column_stack([axis.values for axis in axes]), tuple(axis.label for axis in axes))


def _in_time(where: str, conditions: Conditions) -> Quantity:
    if where == "time":
        return Quantity(conditions.time[:, None] / 3600.0, ("time, h",))
    if where == _PAUSE:
        return Quantity(pauses(conditions)[:, None], ("time since the reading before, s",))
    if where == "temperature":
        return Quantity(conditions.temperature[:, None], ("air temperature, °C",))
    return Quantity(conditions.order[:, None] + 1.0, ("reading, in order of time",))


def _of_joint(where: str, k: int, conditions: Conditions, header: Header) -> Quantity | None:
    slides = header.robot.kinds[k] == "slides"
    load, scale = ("force, N", 1.0) if slides else ("torque, N.m", _N_M)
    if where.startswith("torque about"):
        return Quantity(conditions.torque[:, [k]] / scale, (load,))
    if where.startswith("moment across"):
        size = np.linalg.norm(conditions.moment[:, k, :2], axis=1)
        return Quantity(size[:, None] / _N_M, ("moment across the joint, N.m",))
    if where.startswith("last move but one"):
        moved = conditions.earlier[:, [k]] / header.robot.joint_units[k]
        return Quantity(moved, (f"last move but one, {header.robot.units[k]}",))
    if where.startswith("last move"):
        moved = conditions.joints[:, [k]] - conditions.previous[:, [k]]
        return Quantity(moved / header.robot.joint_units[k], (f"last move, {header.robot.units[k]}",))
    if where.startswith("last change of torque"):
        before = gravity_torques(header.robot, conditions.previous, header.loads, header.gravity)
        change = conditions.torque[:, [k]] - before[:, [k]]
        name, _, unit = load.partition(", ")
        return Quantity(change / scale, (f"change of {name} in the last move, {unit}",))
    if where.startswith("side of approach"):
        side = (conditions.side[:, k] > 0).astype(np.int64)
        return replace(
            _over([k], conditions), group=side, group_names=("arrived from above", "arrived from below")
        )
    return None


def _of_tool(conditions: Conditions, header: Header) -> Quantity:
    axis = forward(header.robot, conditions.joints)[:, :3, 2]
    return _widest(axis, [f"flange's z along the base's {name}" for name in "xyz"])


def _of_view(conditions: Conditions, header: Header) -> Quantity:
    x, y, z = (conditions.point - np.array(header.noise.station_mm)).T
    middle = np.arctan2(y.mean(), x.mean())  # the seam lies behind the instrument
    azimuth = middle + np.angle(np.exp(1j * (np.arctan2(y, x) - middle)))
    both = np.column_stack([azimuth, np.arctan2(z, np.hypot(x, y))]) / DEG
    return Quantity(both, ("azimuth from the instrument, deg", "elevation, deg"))


def _of_distance(conditions: Conditions, header: Header) -> Quantity:
    way = conditions.point - np.array(header.noise.station_mm)
    return Quantity(np.linalg.norm(way, axis=1, keepdims=True), ("distance from the instrument, mm",))


def _of_overturning(conditions: Conditions, _: Header) -> Quantity:
    labels = [f"moment about the base's {name}, N.m" for name in "xyz"]
    return _widest(conditions.overturning / _N_M, labels)


def _in_space(conditions: Conditions, _: Header) -> Quantity:
    return Quantity(conditions.point, ("x, mm", "y, mm", "z, mm"))


def _widest(vectors: Array, labels: list[str]) -> Quantity:
    """Return the two components of vectors (n, 3) that vary most."""
    two = np.sort(np.argsort(-np.std(vectors, axis=0), kind="stable")[:2])
    return Quantity(vectors[:, two], tuple(labels[k] for k in two.tolist()))


_VECTORS: Mapping[str, Callable[[Conditions, Header], Quantity]] = {
    "direction of the tool": _of_tool,
    "direction of view": _of_view,
    "distance from the instrument": _of_distance,
    "overturning moment": _of_overturning,
    "region of the workspace": _in_space,
}
