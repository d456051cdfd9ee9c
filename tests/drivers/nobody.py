"""An address on which no program listens."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def nobody_listens() -> Iterator[int]:
    """Yield a port of this machine that refuses connections until the block ends.

    It stays bound meanwhile. A port that was only free a moment ago may soon belong to another program, which then
    answers. A client that connects to a free port may even get it as the port of its own end.
    """
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield held.getsockname()[1]
