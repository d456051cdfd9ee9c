"""Start child processes, and wait for one while signals are still handled.

Python runs the handler of a signal when the signal interrupts the waiting call. A signal just before that call does not
interrupt it, nor does one that the system gives to another thread. Its handler then runs only after the wait, when the
child has ended. Therefore each signal becomes a byte on a socket here, and so does the end of the child.
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
    """Return the command line that runs a module of this program.

    Files in the current folder, such as a `fleet.py`, cannot replace its modules.
    """
    return [sys.executable, "-P", "-m", module, *arguments]


def run(
    command: Sequence[str],
    heard: Callable[[subprocess.Popen[bytes], int], object],
    *,
    stdin: int | None = None,
    own_session: bool = False,
) -> int:
    """Run a command until it ends and return its exit code. Call it in the main thread.

    Parameters
    ----------
    heard : callable
        Called with the child and the signal number for each SIGTERM and SIGINT that comes meanwhile.
    own_session : bool
        Whether the child gets its own session.

    Raises
    ------
    OSError
        The program does not exist.
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
