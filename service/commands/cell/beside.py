"""Computations beside a measurement at a terminal, in another process: the robot does not wait for them."""

from __future__ import annotations

import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context, parent_process
from pathlib import Path
from typing import TypeVar

from acquisition.run import Begin

_T = TypeVar("_T")


def _begun_beside() -> None:
    """Leave Ctrl-C to the program that began this process, and end with it, also when it is killed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    parent = parent_process()
    assert parent is not None

    def follow() -> None:
        parent.join()
        os._exit(0)

    threading.Thread(target=follow, daemon=True).start()


@contextmanager
def beside() -> Iterator[Begin]:
    """Yield a function that begins computations in another process, which starts with the first."""
    workers = ProcessPoolExecutor(1, get_context("spawn"), _begun_beside)

    def begin(function: Callable[[Path], _T], record_dir: Path, /) -> Future[_T]:
        return workers.submit(function, record_dir)

    try:
        yield begin
    finally:
        workers.shutdown(cancel_futures=True)
