"""The guard runs a command that must not outlive its parent: `python -m service.guard COMMAND ...`.

The parent holds the other end of our standard input. When it closes, by intent or because the parent was killed,
the command is ended. A signal handler in the parent could not do this: nothing runs after `kill -9`.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Sequence
from types import FrameType

GRACE_S = 3.0  # to end by itself, then it is killed


def main(command: Sequence[str]) -> int:
    """Run the command until it ends or our standard input does; its exit code."""
    with subprocess.Popen(command, stdin=subprocess.DEVNULL) as child:

        def end() -> None:
            child.terminate()
            with contextlib.suppress(subprocess.TimeoutExpired):
                child.wait(GRACE_S)
            child.kill()

        def on_signal(number: int, frame: FrameType | None) -> None:
            threading.Thread(target=end, daemon=True).start()

        def watch() -> None:
            # Not through sys.stdin: its lock, held by this thread, would make the interpreter abort at its end.
            while os.read(0, 1024):
                pass
            end()

        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, on_signal)
        threading.Thread(target=watch, daemon=True).start()
        return child.wait()


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
