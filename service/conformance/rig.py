"""A rig of the conformance suite: one driver, its simulator, a fault proxy between them, and the truth.

A rig asks questions whose right answers all differ, so that an answer to another question shows.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from drivers import Busy
from mocks.faultproxy import FaultProxy  # knows no protocol and simulates nothing: docs/decisions/0059

SLACK_S = 20.0  # what a loaded machine may add to a deadline
_ASK_AGAIN_S = 0.02  # no driver reports the end of a watchdog: it is asked until it agrees


@dataclass
class Rig:
    """A driver behind a proxy. `ask(i)` puts question i and returns by how much it missed the truth.

    `do`: an order to the simulator by its name (`restart`, `clock_step` with `by_s`). `patient` and `hasty`: values of
    the driver's `deadlines`, the second so short that a lost answer costs little time; None where it has none.
    `hasty_requests`: the same where requests are lost; None: as `hasty`.
    `elsewhere`: where the arm was sent though nobody asked for it (deg, model angles).
    """

    driver: Any
    proxy: FaultProxy
    do: Callable[..., object]
    ask: Callable[[int], float]
    tolerance: float
    longest_s: float
    patient: object
    hasty: object
    elsewhere: Callable[[], list[tuple[float, ...]]] = list
    hasty_requests: object = None

    def start_again(self) -> None:
        """No more faults; somebody has looked at the robot, and its program runs again."""
        self.proxy.heal()
        self.be_patient()
        self.do("restart")
        self.restart()

    def restart(self) -> None:
        """Connect and arm; a robot whose watchdog has not stopped it yet is waited for, as a person would."""
        self.driver.connect()
        end = time.monotonic() + SLACK_S
        while True:
            try:
                self.driver.arm()
            except Busy:
                if time.monotonic() > end:
                    raise
                time.sleep(_ASK_AGAIN_S)
            else:
                return

    def hurry(self, *, requests: bool = False) -> None:
        hasty = self.hasty_requests if requests and self.hasty_requests is not None else self.hasty
        if hasty is not None:
            self.driver.deadlines = hasty

    def be_patient(self) -> None:
        if self.patient is not None:
            self.driver.deadlines = self.patient
