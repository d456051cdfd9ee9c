"""One call of the engine: Dask is imported here and nowhere before, so that a cell PC can do without.

Addresses: of a scheduler, and of a store as workers can use it.
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

MISSING = ("dask", "distributed", "cryptography")
"""Packages of the extra that a cell PC has not."""


def diagnose_all(
    sources: Sequence[DatasetSource],
    order: DiagnosisOrder,
    tell: Callable[[str], None],
    progress: Callable[[ProgressCounts], None],
    *,
    workers: int | None = None,
    scheduler: str = "",
) -> ProgressCounts:
    """Diagnose data sets that have no result yet, each result into the store.

    workers: processes of this computer, None for one a processor; scheduler: address of one whose workers do it
    instead. tell: hears sentences about workers; progress: how far it is, after every batch. Raises DataError where the
    extra is not installed, EngineGone, StoreError; what is done is kept, and the same call does the rest.
    """
    if not sources:
        return ProgressCounts(0)
    try:
        from fleet.diagnose.engine import connected, local, processors
        from fleet.diagnose.run import FleetRun
    except ModuleNotFoundError as error:
        if error.name not in MISSING:
            raise
        raise DataError(
            f"needs the package '{error.name}', which a cell PC has not.",
            do="Install it with: pip install 'truepose[fleet]'",
        ) from error
    if scheduler and exposed(scheduler):
        tell(
            f"the way to {scheduler} is open: whoever reaches the scheduler has programs run on its workers, and on "
            "this computer; use tls://, or a network of its own (truepose docs fleet-engine)"
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
    """Let the next call have at once what workers of this computer had in hand: they have ended."""
    if sources:
        with suppress(StoreGone), FleetStore.open(order.store) as store:
            store.work.claim([order.job(each) for each in sources], order.owner, utc_now(), 0.0)


def is_elsewhere(scheduler: str) -> bool:
    """Whether the scheduler of this address is on another computer, as far as the address says."""
    host = _parts(scheduler).hostname or ""
    try:
        return not ip_address(host).is_loopback
    except ValueError:
        return host != "localhost"


def exposed(scheduler: str) -> bool:
    """Whether what goes to this scheduler leaves the computer without TLS."""
    return _parts(scheduler).scheme != "tls" and is_elsewhere(scheduler)


def for_workers(store: str, scheduler: str) -> str:
    """The address of a store for processes that begin in other folders; scheduler: "" for those of this computer.

    Raises DataError for an SQLite file and workers elsewhere, who have no file of this name, or another one.
    """
    try:
        url = sa.make_url(store)
    except exc.ArgumentError:  # refused by the store itself, in its words
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
