"""The end of a command that runs until somebody ends it: Ctrl-C or SIGTERM, heard while it waits."""

from __future__ import annotations

import select
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_ORDERS = (signal.SIGINT, signal.SIGTERM)


class ShutdownSignal:
    """Whether the command was asked to end."""

    def __init__(self, ear: socket.socket) -> None:
        self._ear = ear
        self._heard = False

    def __bool__(self) -> bool:
        return self.wait(0.0)

    def wait(self, seconds: float) -> bool:
        """Wait so long, or until the command is asked to end; whether it was."""
        # By the byte that the interpreter writes at a signal: one that comes just before the wait is heard too.
        while not self._heard and select.select([self._ear], [], [], seconds)[0]:
            self._heard = any(number in _ORDERS for number in self._ear.recv(4096))
        return self._heard


@contextmanager
def until_asked() -> Iterator[ShutdownSignal]:
    """Within, in the main thread, SIGINT and SIGTERM only ask the command to end. A second SIGINT interrupts it."""
    ear, bell = socket.socketpair()
    for each in (ear, bell):
        each.setblocking(False)
    times = 0

    def heard(number: int, frame: FrameType | None) -> None:
        nonlocal times
        times += number == signal.SIGINT
        if times > 1:
            raise KeyboardInterrupt

    bell_before = signal.set_wakeup_fd(bell.fileno(), warn_on_full_buffer=False)
    before = {number: signal.signal(number, heard) for number in _ORDERS}
    try:
        yield ShutdownSignal(ear)
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(bell_before)
        bell.close()
        ear.close()
