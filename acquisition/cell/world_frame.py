"""The world frame from three nests on the table, built by 3-2-1.

The nests must agree with the cell file. The same frame is built from the nests as measured (tracker frame) and as in
the cell file (world frame); the mathematics is that of `calib.arm.world_frame`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from acquisition.errors import NestsDisagree
from calib.arm import WorldFrame, by_three_two_one, frame_of

_TOLERANCE_MM, _MOST_SIGMA = 1.0, 4.0

__all__ = ["WorldFrame", "frame_of", "from_nests"]


def from_nests(
    measured_mm: Mapping[str, ArrayLike],
    nominal_mm: Mapping[str, ArrayLike],
    u_mm: Mapping[str, float] | None = None,
) -> WorldFrame:
    """Compute the transform from the first three nests of `nominal_mm`.

    Each is measured in the tracker's frame. `u_mm` is the standard uncertainty of nominal positions per axis, if
    stated.

    Raises
    ------
    NestsDisagree
        A distance between two nests is off by more than 1 mm, or by more than four standard deviations if that is
        larger.
    """
    known = u_mm or {}
    names = list(nominal_mm)[:3]
    tracker = np.array([measured_mm[name] for name in names], dtype=np.float64)
    world = np.array([nominal_mm[name] for name in names], dtype=np.float64)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        found = float(np.linalg.norm(tracker[i] - tracker[j]))
        expected = float(np.linalg.norm(world[i] - world[j]))
        stated = math.hypot(known.get(names[i], 0.0), known.get(names[j], 0.0))
        if abs(found - expected) > max(_TOLERANCE_MM, _MOST_SIGMA * stated):
            raise NestsDisagree(
                f"{names[i]} and {names[j]} are {found:.2f} mm apart, the cell file says {expected:.2f} mm",
                device="instrument",
                command="world frame",
            )
    return by_three_two_one(tracker, world)
