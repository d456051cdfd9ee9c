"""The world frame from three nests on the table: built by 3-2-1, once the nests agree with the cell file.

The same frame is built from the nests as measured (tracker frame) and as the cell file has them (world frame); the
mathematics is that of `calib.world_frame`.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from acquisition.errors import NestsDisagree
from calib.world_frame import WorldFrame, by_three_two_one, frame_of

__all__ = ["WorldFrame", "frame_of", "from_nests"]


def from_nests(
    measured_mm: Mapping[str, ArrayLike], nominal_mm: Mapping[str, ArrayLike], tolerance_mm: float = 1.0
) -> WorldFrame:
    """The transform from the first three nests of `nominal_mm`, each measured in the tracker's frame.

    Raises NestsDisagree when a distance between two of them is off by more than `tolerance_mm`.
    """
    names = list(nominal_mm)[:3]
    tracker = np.array([measured_mm[name] for name in names], dtype=np.float64)
    world = np.array([nominal_mm[name] for name in names], dtype=np.float64)
    for i, j in ((0, 1), (0, 2), (1, 2)):
        found = float(np.linalg.norm(tracker[i] - tracker[j]))
        expected = float(np.linalg.norm(world[i] - world[j]))
        if abs(found - expected) > tolerance_mm:
            raise NestsDisagree(
                f"{names[i]} and {names[j]} are {found:.2f} mm apart, the cell file says {expected:.2f} mm",
                device="instrument",
                command="world frame",
            )
    return by_three_two_one(tracker, world)
