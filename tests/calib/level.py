"""The palletizer of `tests.calib.machines` as its maker builds it: the rods leave its wrist no room."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array
from tests.calib.machines import machine

COUPLING = {"palletizer": "rods"}
_WRIST = 3


def built(name: str, folder: Path) -> tuple[Robot, str]:
    """A machine, and how its controller counts; the limits of a palletizer hold its wrist at zero."""
    robot = machine(name, folder)
    if name == "palletizer":
        low, high = list(robot.lower), list(robot.upper)
        low[_WRIST], high[_WRIST] = -1e-4, 1e-4
        robot = replace(robot, lower=tuple(low), upper=tuple(high))
    return robot, COUPLING.get(name, "none")


def random_postures(robot: Robot, coupling: str, n: int, seed: int) -> Array:
    """(n, N) of the model, within the limits; the wrist of a palletizer at zero."""
    low, high = np.array(robot.lower), np.array(robot.upper)
    counted = np.random.default_rng(seed).uniform(low, high, (n, robot.joints))
    return robot.model_angles(np.where(high - low < 1e-3, 0.0, counted), coupling)
