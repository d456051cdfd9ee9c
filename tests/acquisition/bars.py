"""Campaigns with a ballbar on fakes, for all tests of a ballbar."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from acquisition import Event, Run
from drivers import Answer
from tests.acquisition.fakes import (
    BALLBAR,
    HEXAPOD,
    Bench,
    Crash,
    JumpingClock,
    SeatingOperator,
    a_campaign,
    a_cell,
    devices_of,
)

# The legs are then off by 0.8 mm on the average, by 2.5 mm at most.
OFF_DEG = (0.1, -0.15, 0.2, -0.1, 0.25, 0.1)
TWO_STAGES = {"kind": "hexapod", "set": "calibration", "count": 24}  # a fit determines the robot by these


class Bar:
    """A ballbar campaign on fakes."""

    def __init__(
        self,
        folder: Path,
        *answers: Answer,
        off_deg: tuple[float, ...] = (0.0,) * 6,
        cell: dict[str, Any] = BALLBAR,
        **campaign: Any,
    ):
        self.folder = folder
        self.bench = Bench(a_cell(**cell), off_deg=off_deg)
        self.run = Run.create(
            folder, self.bench.cell, a_campaign(**({"block": HEXAPOD} | campaign)), simulated=True
        )
        self.operator = SeatingOperator(self.bench, answers)
        self.events: list[Event] = []

    def execute(self) -> str:
        devices = devices_of(self.bench, self.operator)
        return self.run.execute(devices, JumpingClock(), self.events.append).state.value

    def events_of(self, kind: str) -> list[Any]:
        return [dict(event.data) for event in self.events if event.kind == kind]

    def crash_at(self, call: int) -> None:
        """Run until the program ends in this call of a device, and open the record again."""

        def crash() -> None:
            self.run._store.database._connection.close()
            raise Crash

        self.bench.faults[call] = crash
        with pytest.raises(Crash):
            self.execute()
        self.run.close()
        self.run = Run.open(self.folder)


@contextmanager
def made(kind: Callable[..., Any], folder: Path, **usual: Any) -> Iterator[Callable[..., Any]]:
    """Yield a factory of campaigns of `kind`, each with a separate folder.

    The factory's records are closed in the end.
    """
    all_made: list[Bar] = []

    def make(*answers: Answer, **options: Any) -> Any:
        all_made.append(kind(folder / str(len(all_made)), *answers, **(usual | options)))
        return all_made[-1]

    yield make
    for bar in all_made:
        bar.run.close()
