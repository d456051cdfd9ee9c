"""What the readings at hand allow: the input from which every file of the library makes its offers."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.conditions import Conditions
from calib.kinematics import Array
from calib.robot import Robot


@dataclass(frozen=True)
class Survey:
    """The robot, and the conditions of the readings that take part in the fit."""

    robot: Robot
    conditions: Conditions
    everywhere: Conditions | None = None  # of all rows, those too that are only to be predicted

    def recorded(self, name: str) -> bool:
        """Whether a quantity ('time', 'temperature') is there for every row that must ever be predicted."""
        return all(
            bool(np.all(np.isfinite(getattr(c, name))))
            for c in (self.conditions, self.everywhere)
            if c is not None
        )

    @property
    def joint_numbers(self) -> range:
        """1..N."""
        return range(1, self.robot.joints + 1)

    def turns(self, joint: int) -> float:
        """How much of a turn the readings span on a joint."""
        angles = self.conditions.joints[:, joint - 1]
        return float(np.ptp(angles)) / (2.0 * np.pi)

    def varies(self, values: Array) -> bool:
        """Whether a quantity is recorded for every reading and is not the same for all."""
        return bool(np.all(np.isfinite(values)) and np.ptp(values) > 1e-9 * (1.0 + np.max(np.abs(values))))
