"""Servers of the simulators on loopback: started, listed and closed in one place."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import ssl
from collections.abc import Awaitable, Callable, Mapping
from dataclasses import dataclass
from typing import Any

_TURNS = 8  # of the event loop, more than from a socket just accepted to a handler that runs

Handler = Callable[[asyncio.StreamReader, asyncio.StreamWriter], Awaitable[None]]


@dataclass(frozen=True)
class Endpoint:
    """Address on which a simulated device listens.

    `query` is what its client has to know besides the port, as the query of a URL.
    """

    device: str
    protocol: str
    port: int
    host: str = "127.0.0.1"
    scheme: str = "tcp"  # or "udp"
    query: str = ""

    @property
    def url(self) -> str:
        return f"{self.scheme}://{self.host}:{self.port}" + (f"?{self.query}" if self.query else "")

    def line(self) -> dict[str, str | int]:
        line: dict[str, str | int] = {
            "device": self.device,
            "protocol": self.protocol,
            "host": self.host,
            "port": self.port,
        }
        if self.query:
            line["query"] = self.query
        return line if self.scheme == "tcp" else {**line, "url": self.url}


class _Answering(asyncio.DatagramProtocol):
    """Answers each datagram to where it came from, or not at all."""

    def __init__(self, answer: Callable[[bytes], bytes | None]) -> None:
        self._answer = answer
        self._transport: Any = None  # CPython's own is no asyncio.DatagramTransport

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        self._transport = transport

    def datagram_received(self, data: bytes, addr: tuple[str, int]) -> None:
        if (answer := self._answer(data)) is not None:
            self._transport.sendto(answer, addr)


class Servers:
    """All servers of one cell. A handler that ends, or fails on a lost peer, has its connection closed."""

    def __init__(self) -> None:
        self._servers: list[asyncio.Server] = []
        self._datagrams: list[asyncio.DatagramTransport] = []
        self._closed_ports: list[socket.socket] = []
        self._tasks: set[asyncio.Task[None]] = set()
        self._writers: set[asyncio.StreamWriter] = set()

    async def listen(self, handler: Handler, port: int = 0, tls: ssl.SSLContext | None = None) -> int:
        """Listen on a port, 0 for a free one, and return the port; with `tls` by TLS.

        Raises
        ------
        OSError
            The port is taken.
        """

        async def connected(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
            task = asyncio.current_task()
            assert task is not None
            self._tasks.add(task)
            self._writers.add(writer)
            try:
                await handler(reader, writer)
            except (ConnectionError, ssl.SSLError, asyncio.IncompleteReadError, asyncio.CancelledError):
                pass  # the peer is gone, or the cell is shutting down
            finally:
                self._tasks.discard(task)
                self._writers.discard(writer)
                await drop(writer)

        server = await asyncio.start_server(connected, "127.0.0.1", port, ssl=tls)
        self._servers.append(server)
        return int(server.sockets[0].getsockname()[1])

    async def listen_datagrams(self, answer: Callable[[bytes], bytes | None], port: int = 0) -> int:
        """Answer the datagrams to a port, 0 for a free one, and return the port.

        Raises
        ------
        OSError
            The port is taken.
        """
        loop = asyncio.get_running_loop()
        transport, _ = await loop.create_datagram_endpoint(
            lambda: _Answering(answer), local_addr=("127.0.0.1", port)
        )
        self._datagrams.append(transport)
        return int(transport.get_extra_info("sockname")[1])

    async def listen_pair(self, first: Handler, second: Handler, port: int = 0) -> tuple[int, int]:
        """Listen on two neighbouring ports, like 5000 and 5001 of an IRC5.

        Raises
        ------
        OSError
            A port is taken.
        """
        one = await self.listen_around({0: first, 1: second}, port)
        return one, one + 1

    async def listen_around(self, handlers: Mapping[int, Handler | None], port: int = 0) -> int:
        """Listen at fixed distances from one port, like the servers of a UR.

        A port without a handler is taken, and refuses connections. Returns the port at distance 0.

        Raises
        ------
        OSError
            A port is taken.
        """
        others = {offset: handler for offset, handler in handlers.items() if offset}
        for _ in range(100):
            before, closed_before = len(self._servers), len(self._closed_ports)
            one = await self._listen_or_refuse(handlers[0], port)
            try:
                for offset, handler in others.items():
                    await self._listen_or_refuse(handler, one + offset)
                return one
            except (OSError, OverflowError):
                if port:
                    raise
                while len(self._closed_ports) > closed_before:
                    self._closed_ports.pop().close()
                while len(self._servers) > before:
                    last = self._servers.pop()
                    last.close()
                    await last.wait_closed()
        raise OSError("no free ports at these distances")

    async def _listen_or_refuse(self, handler: Handler | None, port: int) -> int:
        if handler is not None:
            return await self.listen(handler, port)
        taken = socket.socket()  # bound without listening: connections to it are refused
        self._closed_ports.append(taken)
        taken.bind(("127.0.0.1", port))
        return int(taken.getsockname()[1])

    async def close(self) -> None:
        """Close servers and connections.

        A server that is closed forgets the sockets it has just accepted (CPython 3.11): so first it accepts no more,
        and those become connections, which are closed like the others.
        """
        loop = asyncio.get_running_loop()
        for transport in self._datagrams:
            transport.close()
        for taken in self._closed_ports:
            taken.close()
        for server in self._servers:
            for each in server.sockets:
                loop.remove_reader(each.fileno())
        for _ in range(_TURNS):
            await asyncio.sleep(0)
        for server in self._servers:
            server.close()
        for task in list(self._tasks):
            task.cancel()
        if self._tasks:
            await asyncio.wait(list(self._tasks))
        for server in self._servers:
            await server.wait_closed()


async def drop(writer: asyncio.StreamWriter, *, reset: bool = False) -> None:
    """Close a connection; `reset` sends RST instead of FIN, as a rebooting controller does."""
    if reset:
        writer.transport.abort()
    writer.close()
    with contextlib.suppress(ConnectionError, ssl.SSLError, asyncio.CancelledError):
        await writer.wait_closed()
