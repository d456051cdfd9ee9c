"""Processor time of a driver per reading, compared with a bare socket on the same bytes.

The bytes of one reading are taken from the wire of a real one. A bare client then sends and receives them over
loopback, and opens a connection wherever the driver opened one. Both threads are timed by their own processor time,
so that neither the simulator nor a busy machine affects the result. The limit for every driver is 1 ms per reading.
"""

from __future__ import annotations

import math
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field

from tests.benchmarks.clock import line
from tests.conformance.readings import READINGS, Setup

WANTED_MS = 1.0
CALLS, TRIES = 100, 3


@dataclass
class Tape:
    """Wire log of (direction, bytes): `!` opened or closed, `>` request, `<` answer."""

    events: list[tuple[str, bytes]] = field(default_factory=list)

    def record(self, device: str, direction: str, data: bytes) -> None:
        self.events.append((direction, data))


def _thread_ms(call: Callable[[], object]) -> float:
    """Least processor time of this thread for one of CALLS calls, ms."""
    least = math.inf
    for _ in range(TRIES):
        begin = time.thread_time()
        for _ in range(CALLS):
            call()
        least = min(least, time.thread_time() - begin)
    return 1000.0 * least / CALLS


def _taped(setup: Setup) -> list[tuple[str, bytes]]:
    """Record the bytes of one reading on the wire; runs of one direction are joined."""
    tape = Tape()
    with ExitStack() as stack:
        read = setup(stack, tape).read
        read()
        tape.events.clear()
        read()
        events = list(tape.events)
    joined: list[tuple[str, bytes]] = []
    for direction, data in events:
        if joined and direction in "<>" and joined[-1][0] == direction:
            joined[-1] = direction, joined[-1][1] + data
        else:
            joined.append((direction, data))
    return joined


@contextmanager
def _replayed(events: list[tuple[str, bytes]]) -> Iterator[int]:
    """Port of a server that goes through the conversation from the other side, over and over."""
    server = socket.create_server(("127.0.0.1", 0))

    def conversation() -> None:
        connection: socket.socket | None = None
        try:
            while True:
                for direction, data in events:
                    if direction == "!" and connection is not None:
                        connection.close()
                        connection = None
                    elif direction != "!":
                        connection = connection or server.accept()[0]
                        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                        if direction == "<":
                            connection.sendall(data)
                        elif not _received(connection, len(data)):
                            return
        except OSError:
            return
        finally:
            if connection is not None:
                connection.close()

    thread = threading.Thread(target=conversation)
    thread.start()
    try:
        yield server.getsockname()[1]
    finally:
        server.shutdown(socket.SHUT_RDWR)
        server.close()
        thread.join()


def _received(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        more = connection.recv(count - len(data))
        if not more:
            return b""
        data += more
    return data


def _bare_ms(events: list[tuple[str, bytes]]) -> float:
    """The same bytes by nothing but sends and receives."""
    with _replayed(events) as port, ExitStack() as stack:
        connection: socket.socket | None = None

        def reading() -> None:
            nonlocal connection
            for direction, data in events:
                if direction == "!" and connection is not None:
                    connection.close()
                    connection = None
                elif direction != "!":
                    if connection is None:
                        connection = socket.create_connection(("127.0.0.1", port))
                        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                    if direction == ">":
                        connection.sendall(data)
                    else:
                        _received(connection, len(data))

        stack.callback(lambda: connection.close() if connection is not None else None)
        return _thread_ms(reading)


def run() -> bool:
    """Print processor time a reading, bare and driven, for every driver."""
    reached = True
    for name, setup in READINGS.items():
        events = _taped(setup)
        bare = _bare_ms(events)
        with ExitStack() as stack:
            driven = _thread_ms(setup(stack, None).read)
        good = driven - bare < WANTED_MS
        reached &= good
        line(
            f"{name}: {driven:.3f} ms a reading, bare {bare:.3f} ms, {driven / bare:.1f} x",
            f"{driven - bare:.3f} ms",
            f"< {WANTED_MS:g} ms",
            good,
        )
    return reached
