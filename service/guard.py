"""Guard for a command that must end with its parent: `python -m service.guard COMMAND ...`.

The parent holds the other end of the guard's standard input. When it closes, by intent or because the parent was
killed, the command is ended. A signal handler in the parent could not do this: nothing runs after `kill -9`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence

from service import child

GRACE_S = 3.0  # to end by itself, then it is killed


def main(command: Sequence[str]) -> int:
    """Run the command and return its exit code.

    The command is ended when this process receives a signal or when its standard input closes.
    """
    threading.Thread(target=_watch, daemon=True).start()
    return child.run(command, _end, stdin=subprocess.DEVNULL)


def _end(process: subprocess.Popen[bytes], _: int) -> None:
    process.terminate()
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(GRACE_S)
    process.kill()


def _watch() -> None:
    # Not through sys.stdin: its lock, held by this thread, would make the interpreter abort at its end.
    while os.read(0, 1024):
        pass
    signal.raise_signal(signal.SIGTERM)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
