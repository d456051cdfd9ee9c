"""The limits of a cell as a driver holds them: every target is held against them before anything is sent."""

from __future__ import annotations

from collections.abc import Sequence

from drivers.errors import ConfigError, JointLimit


class JointLimits:
    """Of one arm. `limits_deg`: a pair a joint, or None for `widest_deg` to either side of zero."""

    def __init__(
        self, limits_deg: Sequence[Sequence[float]] | None, *, joints: int, widest_deg: float, device: str
    ) -> None:
        """Raises ConfigError unless there is a pair for every joint."""
        if limits_deg is not None and len(limits_deg) != joints:
            raise ConfigError(f"limits_deg needs {joints} pairs, not {len(limits_deg)}", device=device)
        self._pairs = [(-widest_deg, widest_deg)] * joints if limits_deg is None else limits_deg
        self._device = device

    def check(self, target_deg: Sequence[float]) -> None:
        """Raises JointLimit naming the first joint that may not go there; NaN may not."""
        if len(target_deg) != len(self._pairs):
            raise JointLimit(
                f"{len(target_deg)} joints given, {len(self._pairs)} needed",
                device=self._device,
                command="move_to",
            )
        for i, (q, (low, high)) in enumerate(zip(target_deg, self._pairs, strict=True), start=1):
            if not low <= q <= high:
                raise JointLimit(
                    f"joint {i} to {q:g} deg, allowed {low:g} to {high:g}",
                    device=self._device,
                    command="move_to",
                )
