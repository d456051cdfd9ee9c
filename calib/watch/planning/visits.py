"""Visits that a watch could make: where the robot rests, from where it comes, and what is read there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from calib.array import Array

Read = tuple[tuple[str, str], ...]
"""What is read in a visit: targets of the tool, each with the base target to which its distance is measured, or "" for
its point."""


@dataclass(frozen=True)
class Visits:
    """V visits: joints (V, N), rad or mm; sides (V, N), +1 from below, -1 from above; reach (V,), rad: length of the
    last move; read: of each visit what is read."""

    joints: Array
    sides: Array
    reach: Array
    read: tuple[Read, ...]

    @classmethod
    def of_points(cls, joints: Array, sides: Array, reach: Array, targets: Sequence[str]) -> Visits:
        """Points of the same targets in every visit."""
        return cls(joints, sides, reach, (tuple((name, "") for name in targets),) * len(joints))

    def __len__(self) -> int:
        return len(self.joints)

    @property
    def readings(self) -> int:
        """Number of readings."""
        return sum(len(each) for each in self.read)

    def take(self, index: Sequence[int] | NDArray[np.int64]) -> Visits:
        """Some of the visits."""
        some = np.asarray(index, dtype=np.int64)
        return Visits(
            self.joints[some], self.sides[some], self.reach[some], tuple(self.read[i] for i in some)
        )

    def read_again(self, times: int) -> Visits:
        """The visits with every reading repeated so many times in each rest of the robot."""
        return replace(
            self, read=tuple(tuple(pair for pair in each for _ in range(times)) for each in self.read)
        )

    def again(self, times: int) -> Visits:
        """Every visit so many times, every other time from the opposite sides; the whole round before the next."""
        rounds = [replace(self, sides=self.sides * (-1.0) ** k) for k in range(times)]
        return Visits(
            np.concatenate([each.joints for each in rounds]),
            np.concatenate([each.sides for each in rounds]),
            np.concatenate([each.reach for each in rounds]),
            self.read * times,
        )
