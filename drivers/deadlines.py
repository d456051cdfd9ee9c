"""The named waits of the instruments, s, both of bridges and of emScon."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class InstrumentDeadlines:
    """Named waits in seconds.

    A measurement may take its samples' time + `measure_margin_s`.

    Attributes
    ----------
    takeover_s
        Time in which a server notices that its last client is gone.
    init_s
        For an initialisation.
    point_s
        For pointing at a target.
    """

    connect_s: float = 3.0
    send_s: float = 1.0
    reply_s: float = 2.0
    init_s: float = 180.0
    point_s: float = 15.0
    takeover_s: float = 1.0
    measure_margin_s: float = 5.0
