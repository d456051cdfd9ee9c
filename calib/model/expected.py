"""Effects that were found in other robots of the type: they share half of the chance of a false effect.

A search that may err once in so many tries (`calib.scan.scores`) can spend them as it likes, as long as the shares
were fixed before the readings and add up to one: a place with share w counts for 1 / w tries. So what is frequent in a
type needs less evidence, everything else twice as much, and claims on robots that lack nothing stay as rare.
Source: Genovese, Roeder and Wasserman 2006 (weighted p-values).
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from calib.model.effect import Effect


@dataclass(frozen=True)
class Expected:
    """An effect by its label and shape, and its share of all tries."""

    label: str
    shape: Mapping[str, float]
    share: float

    @property
    def place(self) -> Effect:
        """The effect without its parameters: enough to find its place in a scan."""
        return Effect(self.label, "transmission", "robot", "", (), (), self.shape)
