"""A data set: the readings of a campaign as arrays, with their header. Frozen once read.

Rows of `set = validation` never enter a fit or a choice: `fit_rows` leaves them out.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from calib.arm.weight import joints_under_gravity
from calib.array import Array
from calib.data.conditions import Conditions
from calib.data.header import Header
from calib.data.spans import Span

SETS = ("calibration", "reference", "repeat", "validation")


@dataclass(frozen=True)
class Dataset:
    """n readings, and the header that holds for all of them."""

    path: Path
    header: Header
    reading_id: tuple[str, ...]
    sets: NDArray[np.str_]  # (n,)
    status: NDArray[np.str_]  # (n,) empty or "ok", else "rejected:REASON"
    conditions: Conditions
    points: Array  # (n, 3) mm, NaN where not measured
    orientation: Array  # (n, 4) quaternion, scalar first, NaN where not measured
    lengths: Array  # (n,) mm from the tool target to the base target, NaN where not measured
    u_point: Array  # (n, 3) mm, NaN where the header's noise holds
    u_rotation: Array  # (n,) rad, likewise
    u_length: Array  # (n,) mm, likewise
    sha256: str
    arrivals_told: bool = (
        True  # whether the file says how joints arrived; else the order of its rows stands in
    )
    read_apart: Array | None = (
        None  # (n, N) joints read back less commanded ones, rad or mm, NaN where not read
    )
    spans: tuple[Span, ...] = ()  # distances between balls of one body, in which the arm takes no part

    def __len__(self) -> int:
        return len(self.reading_id)

    @property
    def name(self) -> str:
        """Name of the file."""
        return self.path.name

    @property
    def waypoint(self) -> NDArray[np.int64]:
        """Number of the pose if the file numbers them, shape (n,); -1 elsewhere."""
        return self.conditions.waypoint

    @cached_property
    def pointed(self) -> NDArray[np.bool_]:
        """Whether a point was measured, shape (n,)."""
        return np.isfinite(self.points[:, 0])

    @cached_property
    def turned(self) -> NDArray[np.bool_]:
        """Whether an orientation was measured and its noise declared, shape (n,).

        Without a declared noise an orientation is not used.
        """
        weighed = np.isfinite(self.u_rotation) | (self.header.noise.rotation > 0.0)
        return np.isfinite(self.orientation[:, 0]) & weighed

    @cached_property
    def spanned(self) -> NDArray[np.bool_]:
        """Whether a distance was measured, shape (n,)."""
        return np.isfinite(self.lengths)

    @cached_property
    def usable(self) -> NDArray[np.bool_]:
        """Whether the row was measured and not rejected, shape (n,)."""
        return np.isin(self.status, ("", "ok")) & (self.pointed | self.spanned)

    @cached_property
    def fit_rows(self) -> NDArray[np.bool_]:
        """Whether the row may enter a fit, shape (n,)."""
        return self.usable & (self.sets != "validation")

    @cached_property
    def validation_rows(self) -> NDArray[np.bool_]:
        """Whether the row was measured and is held out, shape (n,)."""
        return self.usable & (self.sets == "validation")

    @cached_property
    def placing(self) -> Dataset:
        """The data set from which a robot is placed.

        It is this one, unless all measured rows are validation rows. Then these become calibration rows.
        """
        if self.fit_rows.any():
            return self
        return replace(self, sets=np.where(self.sets == "validation", "calibration", self.sets))

    @cached_property
    def weightless(self) -> tuple[int, ...]:
        """Joints that gravity loads, if no load is known.

        The model then takes them for weightless.
        """
        header = self.header
        if header.loads:
            return ()
        return joints_under_gravity(
            header.robot, self.conditions.joints[self.placing.fit_rows], header.gravity
        )

    @cached_property
    def numbers(self) -> int:
        """Number of measured values in the rows that enter a fit."""
        rows = self.fit_rows
        return int(
            3 * (self.pointed & rows).sum() + 3 * (self.turned & rows).sum() + (self.spanned & rows).sum()
        )
