"""A POSIX serial line (pseudo-terminal), which a real driver opens like `/dev/rfcomm0`.

Windows has none. The module is therefore imported only when a line is opened.
"""

from __future__ import annotations

import asyncio
import os
import tty
from collections.abc import Awaitable, Callable
from dataclasses import dataclass

from mocks.shared.sockets import Endpoint

Serve = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


@dataclass(frozen=True)
class PtyEndpoint(Endpoint):
    """Address of a simulated serial device, which has no port."""

    path: str = ""

    @property
    def url(self) -> str:
        return self.path

    def line(self) -> dict[str, str | int]:
        return {"device": self.device, "protocol": self.protocol, "url": self.path}


async def open_line(serve: Serve) -> tuple[PtyEndpoint, list[Callable[[], object]]]:
    """Serve on a new line; what to call to unplug it. Its other end stays open, so that clients may come and go."""
    ours, theirs = os.openpty()
    tty.setraw(theirs)
    loop, reader = asyncio.get_running_loop(), asyncio.StreamReader()
    read, _ = await loop.connect_read_pipe(
        lambda: asyncio.StreamReaderProtocol(reader), os.fdopen(os.dup(ours), "rb", 0)
    )
    write, flow = await loop.connect_write_pipe(asyncio.streams.FlowControlMixin, os.fdopen(ours, "wb", 0))
    writer = asyncio.StreamWriter(write, flow, None, loop)
    serving = asyncio.ensure_future(serve(reader, writer))
    closing = [serving.cancel, read.close, write.close, lambda: os.close(theirs)]
    return PtyEndpoint("qc20w-serial", "mbp1", port=0, path=os.ttyname(theirs)), closing
