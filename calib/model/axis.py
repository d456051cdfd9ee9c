"""The axis over which the picture of an effect is drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from calib.array import Array
from calib.data.conditions import Conditions
from calib.units import DEG


@dataclass(frozen=True)
class Axis:
    """Axis of a picture: a label with its unit, and values (n,) in that unit.

    Attributes
    ----------
    joint : int or None
        Joint whose position it is; None for another quantity.
    cycles : float
        Periods per turn of a periodic law.
    sided : bool
        Whether the law differs between the two sides of approach.
    """

    label: str
    values: Array
    joint: int | None = None
    cycles: float = 0.0
    sided: bool = False

    @classmethod
    def angle(cls, joint: int, conditions: Conditions, *, cycles: float = 0.0, sided: bool = False) -> Axis:
        """Build the axis for the position of a joint: an angle, deg, or a place along it, mm."""
        at = conditions.joints[:, joint - 1]
        name = (conditions.axis_names or {joint - 1: f"j{joint}"})[joint - 1]
        if unit_of(joint, conditions) == "mm":
            return cls(f"{name}, mm", at, joint, cycles, sided)
        return cls(f"θ{name.removeprefix('j')}, deg", at / DEG, joint, cycles, sided)


def unit_of(joint: int, conditions: Conditions) -> str:
    """Return the unit in which a joint is read, "deg" or "mm"."""
    return conditions.unit_names[joint - 1] if conditions.unit_names else "deg"


@runtime_checkable
class PlotAxis(Protocol):
    """A regressor that is, or follows from, one quantity over which the residual can be drawn."""

    def drawn_over(self, conditions: Conditions) -> Axis:
        """Return the quantity over which a regressor is drawn."""
        ...
