"""The outcome of a correction, target by target: the joints to drive, or why it must not be driven."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from calib.array import Array


class Status(StrEnum):
    """The outcome of one target."""

    CORRECTED = "corrected"
    OUT_OF_REACH = "out of reach"
    SINGULAR = "singular"
    BEYOND_LIMITS = "beyond limits"
    NOT_CONVERGED = "not converged"
    OUTSIDE_REGION = "outside the region of the regression"


ALL = tuple(Status)
REASONS = {
    Status.CORRECTED: "",
    Status.OUT_OF_REACH: "the arm does not reach the target in its branch within the joint limits",
    Status.SINGULAR: "close to a singular pose, where a small correction needs a large turn of the joints",
    Status.BEYOND_LIMITS: "the target or its correction lies beyond a joint limit",
    Status.OUTSIDE_REGION: "outside the joint angles that the regression in the model was trained at, where it means "
    "nothing",
    Status.NOT_CONVERGED: "the iteration did not end near the target: it would change the branch, or the model is wild",
}


@dataclass(frozen=True)
class Correction:
    """Corrected targets. `joints` (n, N) rad, NaN where refused: a refused target must never be driven.

    landed (n,) mm and turned (n,) rad: how far from the wanted pose the calibrated model is at `joints`;
    iterations (n,): how many the target took.
    """

    joints: Array
    status: tuple[Status, ...]
    landed: Array
    turned: Array
    iterations: NDArray[np.int64]

    @property
    def good(self) -> NDArray[np.bool_]:
        """(n,) targets that may be driven."""
        return np.array([s is Status.CORRECTED for s in self.status], dtype=bool)

    @property
    def reasons(self) -> tuple[str, ...]:
        """Why each target was refused, as a sentence part; empty where it was not."""
        return tuple(REASONS[s] for s in self.status)

    @classmethod
    def of(
        cls,
        joints: Array,
        refusals: Sequence[tuple[Status, NDArray[np.bool_]]],
        landed: Array,
        turned: Array,
        iterations: NDArray[np.int64],
    ) -> Correction:
        """A correction from the rows that were refused, by reason, the weightiest last: it is the one that is kept."""
        status = np.zeros(len(joints), dtype=np.int64)
        for reason, rows in refusals:
            status[rows] = ALL.index(reason)
        return cls(
            np.where((status == 0)[:, None], joints, np.nan),
            tuple(ALL[i] for i in status),
            landed,
            turned,
            iterations,
        )
