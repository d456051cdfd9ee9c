"""An address at which nobody listens."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def nobody_listens() -> Iterator[int]:
    """
    A port of this machine that refuses connections until the block ends.

    It stays bound meanwhile. A port that was merely free a moment ago is soon somebody else's, who then
    answers, and whoever connects to a free one may even be given it as its own end.
    """
    with socket.socket() as held:
        held.bind(("127.0.0.1", 0))
        yield held.getsockname()[1]
