"""The named waits of the UR driver, s."""

from __future__ import annotations

from dataclasses import dataclass, replace


@dataclass(frozen=True, slots=True)
class UrDeadlines:
    """Named waits in seconds.

    A program has `start_s` to begin; a move may take `move_factor` x its predicted time + `move_margin_s`. In
    `settle_s` the joints must reach targets that are already at rest.
    """

    connect_s: float = 3.0
    send_s: float = 1.0
    reply_s: float = 2.0
    start_s: float = 2.0
    settle_s: float = 2.0
    stop_s: float = 2.0
    move_factor: float = 2.0
    move_margin_s: float = 10.0

    @property
    def quick(self) -> UrDeadlines:
        """Short deadlines for the first attempts of a stop, so that other ports are tried in time."""
        return replace(self, connect_s=min(self.connect_s, 1.0), reply_s=min(self.reply_s, 0.3))
