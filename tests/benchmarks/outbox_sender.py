"""`python -m tests.benchmarks.outbox_sender OUTBOX PORT TOKEN`: send all waiting documents.

The clock jumps instead of waiting.
"""

from __future__ import annotations

import sys
import threading
from contextlib import closing
from pathlib import Path

from fleet.outbox import Outbox, Sender, ServerLink

_PAUSE = threading.Event()
LONGEST_S = 0.2  # of a wait, in truth: the server may be starting


def main() -> int:
    """Exit code 0 when all is acknowledged, 1 where something was set aside."""
    file, port, token = sys.argv[1:]
    jumped = 0.0
    with Outbox(Path(file)) as outbox, closing(ServerLink(f"http://127.0.0.1:{port}", token)) as link:
        sender = Sender(outbox, link, lambda: jumped)
        while (done := sender.round()).wait_s is not None:
            jumped += done.wait_s
            if done.trouble and not done.kept:
                _PAUSE.wait(min(done.wait_s, LONGEST_S))
        return 1 if outbox.entries("aside") else 0


if __name__ == "__main__":
    sys.exit(main())
