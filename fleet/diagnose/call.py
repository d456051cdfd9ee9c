"""One call of the engine.

Dask is imported here and nowhere before, so that a cell PC can do without it. The addresses are that of a scheduler,
and that of a store in a form that workers can use.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from ipaddress import ip_address
from pathlib import Path
from urllib.parse import SplitResult, urlsplit

import sqlalchemy as sa
from sqlalchemy import exc

from calib.errors import DataError
from fleet.diagnose.batch import DatasetSource, DiagnosisOrder
from fleet.diagnose.progress import ProgressCounts
from fleet.errors import StoreGone
from fleet.store import FleetStore, utc_now


def diagnose_all(
    sources: Sequence[DatasetSource],
    order: DiagnosisOrder,
    tell: Callable[[str], None],
    progress: Callable[[ProgressCounts], None],
    *,
    workers: int | None = None,
    scheduler: str = "",
) -> ProgressCounts:
    """Diagnose data sets that have no result yet, and store each result.

    Finished results are kept when the call fails, and the same call later does the rest.

    Parameters
    ----------
    tell
        Called with sentences about workers.
    progress
        Called with the progress after every batch.
    workers
        Number of processes of this computer. Default: one per processor.
    scheduler
        Address of a scheduler whose workers are used instead.

    Raises
    ------
    ModuleNotFoundError
        The extra `fleet` is not installed.
    EngineGone
        The scheduler or all workers are gone.
    StoreError
        Results cannot be kept.
    """
    if not sources:
        return ProgressCounts(0)
    from fleet.diagnose.engine import connected, local, processors  # of the extra `fleet`
    from fleet.diagnose.run import FleetRun

    if scheduler and exposed(scheduler):
        tell(
            f"the way to {scheduler} is open: whoever reaches the scheduler has programs run on its workers, and on "
            "this computer; use tls://, or a network of its own (truepose docs fleet)"
        )
    spent = time.process_time()
    FleetStore.open(order.store).close()  # tables are made before workers come to them together
    run: FleetRun | None = None
    try:
        with connected(scheduler) if scheduler else local(workers or processors()) as client:
            run = FleetRun(client, order, sources, tell)
            tally = run.run(progress)
    finally:
        if run is not None and not scheduler:
            _free(run.in_hand, order)
    tally.start_s = time.process_time() - spent - tally.overhead_s
    return tally


def _free(sources: Sequence[DatasetSource], order: DiagnosisOrder) -> None:
    """Release the claims of workers of this computer that have ended, for the next call."""
    if sources:
        with suppress(StoreGone), FleetStore.open(order.store) as store:
            store.work.claim([order.job(each) for each in sources], order.owner, utc_now(), 0.0)


def is_elsewhere(scheduler: str) -> bool:
    """Check whether the scheduler is on another computer, according to its address."""
    host = _parts(scheduler).hostname or ""
    try:
        return not ip_address(host).is_loopback
    except ValueError:
        return host != "localhost"


def exposed(scheduler: str) -> bool:
    """Check whether data to this scheduler leaves the computer without TLS."""
    return _parts(scheduler).scheme != "tls" and is_elsewhere(scheduler)


def for_workers(store: str, scheduler: str) -> str:
    """Return the address of a store for processes that start in other folders.

    `scheduler` is "" for processes of this computer.

    Raises
    ------
    DataError
        The store is an SQLite file, and workers on other computers do not have this file.
    """
    try:
        url = sa.make_url(store)
    except exc.ArgumentError:  # refused by the store itself, with its message
        return store
    if url.get_backend_name() != "sqlite" or not url.database:
        return store
    if scheduler and is_elsewhere(scheduler):
        raise DataError(
            "is a file of this computer, which workers elsewhere cannot write to.",
            do="Give a PostgreSQL, or leave --scheduler out.",
            key="--store",
        )
    return url.set(database=str(Path(url.database).absolute())).render_as_string(hide_password=False)


def _parts(scheduler: str) -> SplitResult:
    return urlsplit(scheduler if "://" in scheduler else f"tcp://{scheduler}")
