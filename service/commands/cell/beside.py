"""Computations in another process, during a measurement at a terminal.

The robot does not wait for them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

from acquisition.run import Begin


@contextmanager
def beside() -> Iterator[Begin]:
    """Yield a function that begins computations in another process, which no Ctrl-C reaches.

    It starts with the first computation, and ends at once with the block or with this program.
    """
    from service.http.runs.run_manager import RunComputations  # long to import
    from service.http.work.workers import Workers

    workers = Workers(1, waiting=1)
    try:
        yield RunComputations(workers)
    finally:
        workers.close()
