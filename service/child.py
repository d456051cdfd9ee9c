"""Child processes: how they are started, and how one is waited for while signals are heard.

Python runs the handler of a signal when the call that waits is interrupted. A signal that comes just before that call
interrupts nothing, nor does one that the system gives to another thread: then its handler runs after the wait, that
is when the child has ended. So each signal is a byte on a socket here, and the end of the child is one more.
"""

from __future__ import annotations

import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Callable, Sequence

_ENDED = 0  # no signal has this number


def python(module: str, *arguments: str) -> list[str]:
    """The command line of a module of ours; what lies in the current folder, as a `fleet.py`, is no part of it."""
    return [sys.executable, "-P", "-m", module, *arguments]


def run(
    command: Sequence[str],
    heard: Callable[[subprocess.Popen[bytes], int], object],
    *,
    stdin: int | None = None,
    own_session: bool = False,
) -> int:
    """Run a command until it ends; its exit code. In the main thread.

    heard: called with the child and the number of each SIGTERM and SIGINT that comes meanwhile. Raises OSError where
    there is no such program.
    """
    ours, theirs = socket.socketpair()
    with ours, theirs:
        theirs.setblocking(False)
        wakened = signal.set_wakeup_fd(theirs.fileno())
        handlers = {each: signal.signal(each, lambda *_: None) for each in (signal.SIGTERM, signal.SIGINT)}
        try:
            with subprocess.Popen(command, stdin=stdin, start_new_session=own_session) as child:

                def wait() -> None:
                    child.wait()
                    theirs.send(bytes([_ENDED]))

                threading.Thread(target=wait, daemon=True).start()
                while (number := ours.recv(1)[0]) != _ENDED:
                    heard(child, number)
                return child.returncode
        finally:
            for each, handler in handlers.items():
                signal.signal(each, handler)
            signal.set_wakeup_fd(wakened)
