"""A rig of the conformance suite: one driver, its simulator, a fault proxy between them, and the truth.

A rig asks questions whose right answers all differ, so that an answer to another question shows.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

from mocks.cell import CellThread
from mocks.faultproxy import FaultProxy

SCALE = 5000.0  # a 20 deg move at 20 deg/s takes 0.2 ms
SLACK_S = 20.0  # what a loaded machine may add to a deadline


class Driver(Protocol):
    """What the suite needs of a driver, whatever it measures or moves."""

    name: str
    deadlines: Any

    def connect(self) -> None: ...
    def arm(self) -> None: ...


@dataclass
class Rig:
    """A driver behind a proxy. `ask(i)` puts question i and returns by how much it missed the truth.

    `patient` and `hasty`: deadlines of the driver, the second so short that a lost answer costs little time.
    """

    driver: Driver
    proxy: FaultProxy
    cell: CellThread
    ask: Callable[[int], float]
    tolerance: float
    longest_s: float
    patient: object
    hasty: object

    def restart(self) -> None:
        self.driver.connect()
        self.driver.arm()

    def hurry(self) -> None:
        self.driver.deadlines = self.hasty

    def be_patient(self) -> None:
        self.driver.deadlines = self.patient
