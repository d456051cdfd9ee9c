"""Regressors of gravity: torques about the joints and moments that bend the arm, with the loads of the readings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from calib.array import Array
from calib.data.conditions import Conditions
from calib.model.axis import Axis


@dataclass(frozen=True)
class Torque:
    """Gravity torque about a joint, N.mm."""

    joint: int

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) N.mm."""
        return conditions.torque[:, self.joint - 1]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The torque itself."""
        return Axis(f"gravity torque of joint {self.joint}, N·m", self.evaluate(conditions) / 1000.0)


@dataclass(frozen=True)
class TorqueCubed:
    """Third power of the gravity torque about a joint, (N.mm)^3."""

    joint: int

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) (N.mm)^3."""
        return conditions.torque[:, self.joint - 1] ** 3

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The torque, of which it is a function."""
        return Torque(self.joint).drawn_over(conditions)


@dataclass(frozen=True)
class TorqueSign:
    """Sign of the gravity torque about a joint, smoothed as tanh(torque / width); width in N.mm."""

    joint: int
    width: float

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) from -1 to 1."""
        return np.tanh(conditions.torque[:, self.joint - 1] / self.width)

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The torque, of which it is a function."""
        return Torque(self.joint).drawn_over(conditions)


@dataclass(frozen=True)
class LoadTorque:
    """Torque about a joint of a load on the last link: mass_kg, and x, y, z its mass x centre in that link, kg mm."""

    joint: int
    mass_kg: float
    x: float
    y: float
    z: float

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) N.mm."""
        return conditions.unit_load[:, self.joint - 1] @ np.array([self.mass_kg, self.x, self.y, self.z])


@dataclass(frozen=True)
class Moment:
    """Gravity moment at a joint about one axis (0, 1, 2) of the frame just before it turns."""

    joint: int
    axis: int

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) N.mm."""
        return conditions.moment[:, self.joint - 1, self.axis]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The moment itself."""
        return Axis(f"gravity moment at joint {self.joint}, N·m", self.evaluate(conditions) / 1000.0)


@dataclass(frozen=True)
class MomentBehind:
    """Gravity moment at a joint about the x axis behind it, which has turned by theta + `zero` (rad) about z."""

    joint: int
    zero: float

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) N.mm."""
        theta, moment = conditions.joints[:, self.joint - 1] + self.zero, conditions.moment[:, self.joint - 1]
        return np.cos(theta) * moment[:, 0] + np.sin(theta) * moment[:, 1]

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The moment itself."""
        return Axis(f"gravity moment at joint {self.joint}, N·m", self.evaluate(conditions) / 1000.0)


@dataclass(frozen=True)
class Overturning:
    """Gravity moment of the whole arm about one axis (0, 1, 2) of the base."""

    axis: int

    def evaluate(self, conditions: Conditions) -> Array:
        """(n,) N.mm."""
        return conditions.overturning[:, self.axis]
