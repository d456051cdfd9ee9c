"""Over what the picture of an effect is drawn, where what drives it has an axis of its own."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

from calib.array import Array
from calib.data.conditions import Conditions


@dataclass(frozen=True)
class Axis:
    """A label with its unit, and (n,) values in that unit."""

    label: str
    values: Array


@runtime_checkable
class Drawn(Protocol):
    """A regressor that is, or follows from, one quantity over which the residual can be drawn."""

    def drawn_over(self, conditions: Conditions) -> Axis:
        """The quantity that a regressor is drawn over."""
        ...
