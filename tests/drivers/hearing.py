"""A link whose device gives answers chosen by the test to any request, and hangs up."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.link import TcpLink


@contextmanager
def hearing(link: TcpLink, *answers: bytes, unasked: bool = False) -> Iterator[None]:
    """One answer to each message sent; with `unasked` all of them are there already."""
    ours, theirs = socket.socketpair()
    left = list(answers)

    def give() -> None:
        if left:
            theirs.sendall(left.pop(0))
        if not left:
            theirs.close()

    def opened(*, connect_s: float) -> None:
        link._socket = ours
        while unasked and left:
            give()

    def send(request: bytes, *, command: str, send_s: float) -> None:
        give()

    link.open, link.send = opened, send  # type: ignore[method-assign]
    opened(connect_s=0.0)
    try:
        yield
    finally:
        link.close()
        theirs.close()
