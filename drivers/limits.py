"""Limits of a robot from its cell file: speeds and joints.

Every target is checked before it is sent.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

from drivers.errors import ConfigError, JointLimit

# Longest arm of a small robot from a joint axis to the tool, mm, rounded up.
_LEVER_MM = (1000.0, 1000.0, 1000.0, 400.0, 400.0, 400.0)


class Caps:
    """The speed limits of one arm and the limits of its joints.

    Attributes
    ----------
    speeds
        Speed of the tool, mm/s, and of a joint, deg/s.

    Parameters
    ----------
    limits_deg
        A pair per joint. Default: `widest_deg` to either side of zero.
    units
        Unit of each joint. Default: deg.
    """

    def __init__(
        self,
        speed_mm_s: float,
        speed_deg_s: float,
        limits_deg: Sequence[Sequence[float]] | None,
        *,
        joints: int,
        widest_deg: float,
        device: str,
        units: Sequence[str] = (),
    ) -> None:
        """Store the limits.

        Raises
        ------
        ConfigError
            A speed is not positive, or there is not one pair for every joint.
        """
        if not (speed_mm_s > 0 and speed_deg_s > 0):
            raise ConfigError(
                f"speeds must be positive, not {speed_mm_s} mm/s, {speed_deg_s} deg/s",
                device=device,
                what_to_do="Correct the speeds in the cell file.",
            )
        if limits_deg is not None and len(limits_deg) != joints:
            raise ConfigError(
                f"limits_deg needs {joints} pairs, not {len(limits_deg)}",
                device=device,
                what_to_do="Give a pair of limits per joint.",
            )
        self.speeds = (speed_mm_s, speed_deg_s)
        self._pairs = [(-widest_deg, widest_deg)] * joints if limits_deg is None else limits_deg
        self._device = device
        self._units = units or ["deg"] * joints

    def check(self, target_deg: Sequence[float]) -> None:
        """Check a target.

        Raises
        ------
        JointLimit
            A joint is beyond its limits, or NaN; the message names the first one.
        """
        if len(target_deg) != len(self._pairs):
            raise JointLimit(
                f"{len(target_deg)} joints given, {len(self._pairs)} needed",
                device=self._device,
                command="move_to",
            )
        for i, (q, (low, high)) in enumerate(zip(target_deg, self._pairs, strict=True), start=1):
            if not low <= q <= high:
                raise JointLimit(
                    f"joint {i} to {q:g} {self._units[i - 1]}, allowed {low:g} to {high:g}",
                    device=self._device,
                    command="move_to",
                )

    def seconds(self, turns_deg: Sequence[float]) -> float:
        """Compute the shortest duration of a joint move, s, within both speed limits.

        `turns_deg` are the angles of its joints (deg, not negative). The joints keep one limit. The speed of the tool
        is at most the sum of angle x lever over the time, and keeps the other.
        """
        path_mm = sum(math.radians(dq) * lever for dq, lever in zip(turns_deg, _LEVER_MM, strict=True))
        return max(max(turns_deg) / self.speeds[1], path_mm / self.speeds[0])
