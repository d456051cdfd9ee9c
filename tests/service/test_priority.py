"""Priorities that let the service receive a stop at once while its workers compute.

Workers have a lower priority, and the objects that stay are not searched by the garbage collector.
"""

from __future__ import annotations

import gc
import os
from collections.abc import Iterator
from contextlib import contextmanager

import pytest
from fastapi import FastAPI

from service.http.access.roles import Tokens
from service.http.server import Server, run_server
from service.http.work.workers import Workers
from service.worker import PATIENT


@contextmanager
def a_worker() -> Iterator[int]:
    """Start a worker and yield the id of its process."""
    workers = Workers(1, waiting=0)
    try:
        yield workers.call(os.getpid)
    finally:
        workers.close()


@pytest.mark.skipif(os.name != "posix", reason="Windows knows no such thing")
def test_a_worker_stands_back_in_its_session() -> None:
    with a_worker() as pid:
        own = os.getpriority(os.PRIO_PROCESS, 0)
        assert os.getpriority(os.PRIO_PROCESS, pid) == min(own + PATIENT, 19)


@pytest.mark.skipif(os.name != "posix", reason="Windows knows no such thing")
def test_a_worker_shares_the_session_of_the_service_and_not_its_ctrl_c() -> None:
    """Linux shares the processors out between sessions.

    In a separate session, a worker's niceness would have no effect.
    """
    with a_worker() as pid:
        assert os.getsid(pid) == os.getsid(0)
        assert os.getpgid(pid) == pid != os.getpgrp()


def test_what_is_loaded_when_the_service_begins_is_not_looked_through_for_garbage(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    left: list[int] = []
    gc.unfreeze()  # what the collection of the tests has put aside
    monkeypatch.setattr("sys.setswitchinterval", lambda seconds: None)  # of this process
    monkeypatch.setattr(Server, "run", lambda self, sockets: left.append(len(gc.get_objects())))
    try:
        run_server(FastAPI(), "127.0.0.1", 0, Tokens("operator", "viewer"), str)
    finally:
        gc.unfreeze()
        every = len(gc.get_objects())
        gc.freeze()
    assert left[0] < every / 10
