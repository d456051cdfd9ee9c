"""The engine that diagnoses data sets: local processes, or workers of a scheduler (Dask).

Any client that reaches a Dask scheduler can run programs on its workers, and their messages are unpickled here. The
processes of this computer therefore use TLS with a key that lives as long as the command, on 127.0.0.1, without web
pages. An address elsewhere that is not tls:// is reported.
"""

from __future__ import annotations

import logging
import os
from collections.abc import Iterator
from contextlib import contextmanager

from dask import config
from distributed import Client, LocalCluster, Security

from calib.errors import DataError
from fleet.diagnose.batch import EngineGone

LOOPBACK = "127.0.0.1"
_TLS = "DASK_DISTRIBUTED__COMM__TLS__"
CONNECT_S = 10
_PLAIN = {
    "distributed.scheduler.allowed-failures": 1,
    "distributed.deploy.lost-worker-timeout": "1h",  # a busy computer takes its time to begin another one
    "distributed.scheduler.http.routes": [],  # web pages that no one requested
    "distributed.worker.http.routes": [],
    "distributed.worker.profile.enabled": False,  # would check the work a hundred times per second
    # Dask's own monitoring many times per second, in every process: 2 % of a processor each, without a use here.
    "distributed.admin.tick.interval": "1s",
    "distributed.admin.system-monitor.interval": "5s",
    "distributed.worker.memory.monitor-interval": "500ms",
    "distributed.scheduler.active-memory-manager.start": False,
}


def processors() -> int:
    """Return the number of processes that this process may run at once."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


@contextmanager
def local(workers: int) -> Iterator[Client]:
    """Run an engine of `workers` local processes, one thread each, during the block."""
    os.environ["PYTHONSAFEPATH"] = (
        "1"  # a file in the current folder, such as a `json.py`, is not part of a worker
    )
    with config.set(_PLAIN):
        cluster = LocalCluster(
            n_workers=workers,
            threads_per_worker=1,
            processes=True,
            host=LOOPBACK,
            dashboard_address=f"{LOOPBACK}:0",
            worker_dashboard_address=f"{LOOPBACK}:0",
            scheduler_kwargs={"dashboard": False},
            security=Security.temporary(),
            silence_logs=logging.CRITICAL,
        )
        with cluster, Client(cluster) as client:
            yield client


@contextmanager
def connected(address: str) -> Iterator[Client]:
    """Connect to the scheduler at an address.

    Raises
    ------
    DataError
        A tls:// address has no usable certificates.
    EngineGone
        No scheduler answers, or it does not accept the certificates.
    """
    for name in (
        "distributed",
        "distributed.client",
    ):  # the second has a separate level: tracebacks on a terminal
        logging.getLogger(name).setLevel(logging.CRITICAL)
    security = _security(address)
    try:
        client = Client(address, timeout=CONNECT_S, security=security)
    except (OSError, ValueError) as error:
        raise EngineGone(
            f"no scheduler answers ({error}).",
            do="Start it ('dask scheduler'), or check the address.",
            file=address,
        ) from error
    with client:
        yield client


def _security(address: str) -> Security:
    """Return the certificates that Dask's settings name.

    Raises
    ------
    DataError
        A tls:// address has none, or they cannot be used.
    """
    security = Security()
    try:
        usable = security.get_connection_args("client")["ssl_context"] is not None
    except OSError as error:  # of ssl too
        raise DataError(
            f"its certificates cannot be used ({error}).",
            do=f"Look at the files that {_TLS}... name.",
            file=address,
        ) from error
    if address.startswith("tls://") and not usable:
        raise DataError(
            "needs certificates.",
            do=f"Name them in {_TLS}CA_FILE, {_TLS}CLIENT__CERT and {_TLS}CLIENT__KEY (truepose docs fleet).",
            file=address,
        )
    return security
