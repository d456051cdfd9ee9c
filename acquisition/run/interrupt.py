"""Ctrl-C at the terminal: once pauses after the current reading, twice stops the robot now.

A terminal that is closed (SIGHUP) pauses at once, independently of the number of signals, because no person watches any
more.
"""

from __future__ import annotations

import signal
import socket
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

from acquisition.run.run import Run

_ORDERS = (signal.SIGINT, signal.SIGTERM)
_HANG_UP: int = getattr(signal, "SIGHUP", 0)  # Windows has none
CLOSED = "The terminal was closed."


@contextmanager
def pausing_on_interrupt(run: Run, tell: Callable[[str], None] = lambda _: None) -> Iterator[None]:
    """Treat SIGINT, SIGTERM and SIGHUP as orders to the run while the block runs.

    The block must run in the main thread. `tell` is called from another thread with a sentence on each device that a
    stop did not reach, because the robot may go on for long.

    A handler runs only when the main thread runs again, and that may just have begun to wait for a person, or for an
    hour of warming up. A thread therefore listens to the byte that the interpreter itself writes at every signal.
    """
    ear, bell = socket.socketpair()
    bell.setblocking(False)
    given: list[threading.Thread] = []

    def stop(by: str) -> None:
        for problem in run.stop(by):
            tell(problem.sentence)

    def hang_up(by: str) -> None:
        run.pause(by, reason=CLOSED, at_once=True)

    def listen() -> None:
        order: Callable[[str], None] = run.pause
        while number := ear.recv(1):
            if number[0] in heard:
                # In a separate thread: the second order must not wait for the first.
                does = hang_up if number[0] == _HANG_UP else order
                given.append(threading.Thread(target=does, args=("terminal",), daemon=True))
                given[-1].start()
                order = order if does is hang_up else stop

    # If it is ignored (`nohup`), the program continues without a terminal.
    closes = _HANG_UP and signal.getsignal(_HANG_UP) is not signal.SIG_IGN
    heard = (*_ORDERS, _HANG_UP) if closes else _ORDERS
    listener = threading.Thread(target=listen, daemon=True)
    listener.start()
    bell_before = signal.set_wakeup_fd(bell.fileno(), warn_on_full_buffer=False)
    before = {number: signal.signal(number, _heard_by_the_thread) for number in heard}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
        signal.set_wakeup_fd(bell_before)
        bell.close()
        listener.join()
        for each in given:  # devices that a stop did not reach are reported before the end
            each.join()
        ear.close()


def _heard_by_the_thread(number: int, frame: FrameType | None) -> None:
    """Do nothing: without a handler the interpreter would raise KeyboardInterrupt, or end."""
