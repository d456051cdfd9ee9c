"""Named waits of the instruments, s: of bridges and of emScon alike."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class InstrumentDeadlines:
    """A measurement may take its samples' time + `measure_margin_s`; `takeover_s`: until a server notices that its
    last client is gone; `init_s`: for an initialisation, `point_s` for pointing at a target.
    """

    connect_s: float = 3.0
    send_s: float = 1.0
    reply_s: float = 2.0
    init_s: float = 180.0
    point_s: float = 15.0
    takeover_s: float = 1.0
    measure_margin_s: float = 5.0
