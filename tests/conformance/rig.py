"""A rig of the conformance suite: one driver, its simulator, a fault proxy between them, and the truth.

A rig asks questions whose right answers all differ, so that an answer to another question shows.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
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
    `elsewhere`: where the arm was sent though nobody asked for it (deg, model angles).
    """

    driver: Driver
    proxy: FaultProxy
    cell: CellThread
    ask: Callable[[int], float]
    tolerance: float
    longest_s: float
    patient: object
    hasty: object
    elsewhere: Callable[[], list[tuple[float, ...]]] = list

    def start_again(self) -> None:
        """No more faults; somebody has looked at the robot, and its program runs again."""
        self.proxy.heal()
        self.be_patient()
        self.cell.do("restart")
        self.restart()

    def restart(self) -> None:
        self.driver.connect()
        self.driver.arm()

    def hurry(self) -> None:
        self.driver.deadlines = self.hasty

    def be_patient(self) -> None:
        self.driver.deadlines = self.patient


def sent_elsewhere(
    cell: CellThread, goals: Sequence[Sequence[float]], within: float
) -> list[tuple[float, ...]]:
    """Targets of moves that the simulated arm began, and that are none of `goals` (deg, model angles)."""
    assert cell.cell is not None
    return [
        sent
        for sent in cell.cell.arm.sent_to
        if not any(max(abs(a - b) for a, b in zip(sent, goal, strict=True)) <= within for goal in goals)
    ]
