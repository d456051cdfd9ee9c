"""A run on fakes for the tests of the sequencer."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from typing import Any

from acquisition import Event, ExecutionOutcome, Run
from acquisition.errors import StorageError
from acquisition.record import RecordStore
from drivers import AcquisitionError
from tests.acquisition.fakes import Bench, JumpingClock, SeatingOperator, a_campaign, a_cell, devices_of


def fill_disk(store: RecordStore) -> None:
    """Fill the file of a record, so that the next addition is refused."""
    count = store.database.query("PRAGMA page_count")[0][0]
    store.database.script(f"PRAGMA max_page_count = {count}")
    with suppress(StorageError):
        while True:
            store.add_event("filler", text="x" * 400)


class Stage:
    """A run on fakes."""

    def __init__(self, folder: Path, *, cell: dict[str, Any] | None = None, **campaign: Any) -> None:
        self.folder = folder
        self.bench = Bench(a_cell(**(cell or {})))
        self.run = Run.create(folder, self.bench.cell, a_campaign(**campaign), simulated=True)
        self.operator: Any = SeatingOperator(self.bench)
        self.clock = JumpingClock()
        self.can_stop = True

    def execute(self, on_event: Callable[[Event], None] | None = None) -> ExecutionOutcome:
        devices = devices_of(self.bench, self.operator, can_stop=self.can_stop)
        return self.run.execute(devices, self.clock, on_event)

    def fail(self, call: int, error: AcquisitionError) -> None:
        def fault() -> None:
            raise error

        self.bench.faults[call] = fault

    def attempts(self) -> list[tuple[str, str, int]]:
        rows = self.run._store.database.query("SELECT kind, status, visit FROM attempt ORDER BY id")
        return [(row[0], row[1], row[2]) for row in rows]


CONNECT = ["connect arm", "connect meter", "arm arm", "arm meter"]  # both are met before one is armed
NESTS = ["measure N1", "measure N2", "measure N3"]
TWO = ["move", "move", "measure T1", "measure T2"]
ALL = [*CONNECT, *NESTS, *TWO, *TWO, "move", "move", "measure T3"]
