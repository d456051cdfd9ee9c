"""The duration of a run, calculated from the plan in its record.

Computations from the record are made at once, or in another process while the run goes on. To read a plan of 5,000
poses takes 0.3 s of the interpreter, which a service shares with the thread that stops a robot.
"""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future
from pathlib import Path
from typing import Protocol, TypeVar

from acquisition.campaign.campaign import campaign_of_record
from acquisition.campaign.plan import Forecast
from acquisition.cell.cell import cell_of_record
from acquisition.record.store import RecordStore

T = TypeVar("T")


class Begin(Protocol):
    """Begins a computation from the record in a folder, perhaps in another process."""

    def __call__(self, function: Callable[[Path], T], record_dir: Path, /) -> Future[T]: ...


def forecast_of(record_dir: Path) -> Forecast:
    """Forecast the whole plan of a record, which another program may be writing.

    Raises
    ------
    RecordError
        There is no record.
    StorageError
        The record cannot be read.
    """
    store = RecordStore.open(record_dir, writer=False)
    try:
        row, where = store.campaign, str(store.database.path)
        visits = dict.fromkeys(planned.visit for planned in store.plan())
    finally:
        store.close()
    cell, campaign = cell_of_record(row["cell"], where), campaign_of_record(row["campaign"], where)
    return Forecast.of(cell, campaign, list(visits))


def at_once(function: Callable[[Path], T], record_dir: Path) -> Future[T]:
    """Compute in the calling thread; errors are those of the function."""
    future: Future[T] = Future()
    future.set_result(function(record_dir))
    return future
