"""End of a command that runs until Ctrl-C or SIGTERM, which are also handled while it waits."""

from __future__ import annotations

import select
import signal
import socket
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

_ORDERS = (signal.SIGINT, signal.SIGTERM)


class ShutdownSignal:
    """Flag that is true once the command has been asked to end."""

    def __init__(self, ear: socket.socket) -> None:
        self._ear = ear
        self._heard = False

    def __bool__(self) -> bool:
        return self.wait(0.0)

    def wait(self, seconds: float) -> bool:
        """Wait up to `seconds`, or until the command is asked to end; return whether it was."""
        # The interpreter writes a byte for each signal, so a signal just before the wait is noticed too.
        while not self._heard and select.select([self._ear], [], [], seconds)[0]:
            self._heard = any(number in _ORDERS for number in self._ear.recv(4096))
        return self._heard


@contextmanager
def until_asked() -> Iterator[ShutdownSignal]:
    """Let SIGINT and SIGTERM only ask the command to end, within this block in the main thread.

    A second SIGINT interrupts it.
    """
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
