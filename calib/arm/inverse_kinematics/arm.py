"""The interface of arms of a known structure: they solve all branches of a batch of poses at once."""

from __future__ import annotations

from typing import Protocol

from calib.arm.inverse_kinematics.solutions import Solutions
from calib.array import Array


class Arm(Protocol):
    """An arm that can be inverted: the names of its branches, and its solutions in their order."""

    @property
    def kind(self) -> str:
        """The method of solution and the structure, in words: "in closed form, SCARA"."""
        ...

    @property
    def branches(self) -> tuple[str, ...]:
        """Names of the branches."""
        ...

    def solve(self, poses: Array, seed: Array) -> Solutions:
        """All branches of flange poses (n, 4, 4), base frame, mm; seed (n, N) for joints that are left free."""
        ...
