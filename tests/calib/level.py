"""Random postures of the machines of `tests.calib.machines`, and their joint counting."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from calib.arm.robot import Robot
from calib.array import Array
from tests.calib.machines import machine

COUPLING = {"palletizer": "rods"}


def built(name: str, folder: Path) -> tuple[Robot, str]:
    """A machine, and how its controller counts."""
    return machine(name, folder), COUPLING.get(name, "none")


def random_postures(robot: Robot, coupling: str, n: int, seed: int) -> Array:
    """Draw model postures within the limits, (n, N); the wrist of a palletizer stays at zero."""
    low, high = np.array(robot.lower), np.array(robot.upper)
    counted = np.random.default_rng(seed).uniform(low, high, (n, robot.joints))
    return robot.model_angles(np.where(high - low < 1e-3, 0.0, counted), coupling)
