"""Over what the picture of an effect is drawn, where what drives it has an axis of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from calib.array import Array
from calib.data.conditions import Conditions
from calib.units import DEG


@dataclass(frozen=True)
class Axis:
    """A label with its unit, and (n,) values in that unit.

    joint: the joint whose angle it is; None for another quantity. cycles: of a law that repeats so many times a turn.
    sided: the law is another one on either side of approach.
    """

    label: str
    values: Array
    joint: int | None = None
    cycles: float = 0.0
    sided: bool = False

    @classmethod
    def angle(cls, joint: int, conditions: Conditions, *, cycles: float = 0.0, sided: bool = False) -> Axis:
        """The angle of a joint, deg."""
        return cls(f"θ{joint}, deg", conditions.joints[:, joint - 1] / DEG, joint, cycles, sided)


@runtime_checkable
class Drawn(Protocol):
    """A regressor that is, or follows from, one quantity over which the residual can be drawn."""

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The quantity that a regressor is drawn over."""
        ...
