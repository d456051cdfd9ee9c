"""One call of the engine: Dask is imported here and nowhere before, so that a cell PC can do without."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from calib.errors import DataError
from fleet.diagnose.address import exposed
from fleet.diagnose.batch import Order
from fleet.diagnose.source import Source
from fleet.diagnose.tally import Tally
from fleet.errors import StoreGone
from fleet.store import Store, utc_now

MISSING = ("dask", "distributed", "cryptography")
"""Packages of the extra that a cell PC has not."""


def diagnose_all(
    sources: Sequence[Source],
    order: Order,
    tell: Callable[[str], None],
    progress: Callable[[Tally], None],
    *,
    workers: int | None = None,
    scheduler: str = "",
) -> Tally:
    """Diagnose data sets that have no result yet, each result into the store.

    workers: processes of this computer, None for one a processor; scheduler: address of one whose workers do it
    instead. tell: hears sentences about workers; progress: how far it is, after every batch. Raises DataError where the
    extra is not installed, EngineGone, StoreError; what is done is kept, and the same call does the rest.
    """
    if not sources:
        return Tally(0)
    try:
        from fleet.diagnose.engine import connected, local, processors
        from fleet.diagnose.run import Run
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
    Store.open(order.store).close()  # tables are made before workers come to them together
    run: Run | None = None
    try:
        with connected(scheduler) if scheduler else local(workers or processors()) as client:
            run = Run(client, order, sources, tell)
            tally = run.run(progress)
    finally:
        if run is not None and not scheduler:
            _free(run.in_hand, order)
    tally.start_s = time.process_time() - spent - tally.overhead_s
    return tally


def _free(sources: Sequence[Source], order: Order) -> None:
    """Let the next call have at once what workers of this computer had in hand: they have ended."""
    if sources:
        with suppress(StoreGone), Store.open(order.store) as store:
            store.work.claim([order.job(each) for each in sources], order.owner, utc_now(), 0.0)
