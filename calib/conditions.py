"""Under which conditions every reading was taken: what drives an effect, as arrays over n readings.

Angles are model angles (behind the joint matrix), rad; times s; temperatures degC; torques and moments N.mm.
A quantity nobody recorded is NaN; regressors that need it are then not offered.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from numpy.typing import NDArray

from calib.kinematics import Array


@dataclass(frozen=True)
class Conditions:
    """Conditions of n readings of a robot with N joints."""

    joints: Array  # (n, N) commanded
    previous: Array  # (n, N) where the robot stood before
    side: Array  # (n, N) +1 when the joint arrived from below, -1 from above
    torque: Array  # (n, N) gravity torque, nominal geometry; this and the next three: see kinematics.Statics
    moment: Array  # (n, N, 3) gravity moment at every joint, axes of the frame just before it turns
    overturning: Array  # (n, 3) gravity moment of the whole arm about the base's origin, axes of the base
    unit_load: Array  # (n, N, 4) torques of 1 kg, and of 1 kg mm along x, y, z, on the last link
    time: Array  # (n,)
    order: Array  # (n,) rank of the reading in its campaign, 0, 1, ...
    temperature: Array  # (n,) air
    point: Array  # (n, 3) where the nominal robot in its place holds the target, mm, world
    series: NDArray[np.int64]  # (n,) index into series_names
    target: NDArray[np.int64]  # (n,) index into target_names
    anchor: NDArray[np.int64]  # (n,) index into anchor_names of the base target of a distance; -1: none
    series_names: tuple[str, ...]
    target_names: tuple[str, ...]
    anchor_names: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.joints)

    def take(self, rows: NDArray[np.bool_] | NDArray[np.int64] | Sequence[int]) -> Conditions:
        """The conditions of some of the readings, by mask or by index."""
        arrays = {f.name: getattr(self, f.name)[rows] for f in fields(self) if not f.name.endswith("_names")}
        return replace(self, **arrays)
