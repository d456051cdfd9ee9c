"""Simulated network and event loops: sockets of drivers, servers of devices, and faults.

A wire is a pipe in each direction. Bytes arrive later, whole or in pieces, in their order, as TCP has it. A wire can be
cut (both ends notice at the next use), fall silent (bytes arrive when it is mended), or be slow.
"""

from __future__ import annotations

import asyncio
import errno
import itertools
import os
import socket
from collections import deque
from collections.abc import Callable
from typing import Any

from tests.simulation.scheduler import Process, Scheduler, Task


class SimulatedWire:
    """One connection from a client's socket (direction 0) to a server's transport and back (1)."""

    def __init__(self, network: Network, number: int, port: int) -> None:
        self.network, self.number, self.port = network, number, port
        self.silent = False
        self.delay_s = 0.0
        self.doubles = 0  # answers that the device will send twice
        self._free_s = [0.0, 0.0]  # when the last piece of each direction has arrived
        self._kept: list[Callable[[], None]] = []  # what was sent into the silence

    def send(self, direction: int, deliver: Callable[[bytes], None], data: bytes) -> None:
        """Let data arrive after a time, perhaps in two pieces."""
        draw = self.network.random
        pieces = [data]
        if len(data) > 1 and draw.random() < self.network.splits:
            at = draw.randrange(1, len(data))
            pieces = [data[:at], data[at:]]
        for piece in pieces:
            self._later(direction, lambda piece=piece: deliver(piece))

    def end(self, direction: int, deliver: Callable[[], None]) -> None:
        """Let the end of the stream arrive after all that was sent."""
        self._later(direction, deliver)

    def _later(self, direction: int, deliver: Callable[[], None]) -> None:
        scheduler = self.network.scheduler
        delay = self.delay_s + 1e-4 * (1.0 + self.network.random.random())
        when = max(self._free_s[direction], scheduler.now + delay)
        self._free_s[direction] = when
        scheduler.at(when, lambda: self._kept.append(deliver) if self.silent else deliver())

    def mend(self) -> None:
        """Let the wire work again: bytes sent into a silence arrive now, as TCP sends them again."""
        self.silent, self.delay_s = False, 0.0
        kept, self._kept = self._kept, []
        for deliver in kept:
            deliver()


class Network:
    """All wires of a simulation, and the ports with a listener."""

    def __init__(self, scheduler: Scheduler) -> None:
        self.scheduler, self.random = scheduler, scheduler.random
        self.splits = 0.1
        self.listeners: dict[int, tuple[SimulatedLoop, Callable[[], Any], SimulatedServer]] = {}
        self.wires: list[tuple[SimulatedWire, ClientSocket, Transport]] = []
        self.names: dict[Any, Process] = {}  # of UNIX sockets
        self.refuses = False  # connections
        self.died: list[str] = []
        self._numbers, self._ports = itertools.count(1), itertools.count(40_000, 10)

    def thread_died(self, name: str, error: Exception) -> None:
        import traceback

        self.died.append(f"{name}: " + "".join(traceback.format_exception(error)))

    def free_port(self) -> int:
        return next(self._ports)

    def connect(self, address: tuple[str, int], timeout: float | None) -> ClientSocket:
        """Connect to a port, as `socket.create_connection` does."""
        self.scheduler.sleep(2e-4)
        listens = self.listeners.get(address[1])
        if listens is None or self.refuses:
            raise ConnectionRefusedError(errno.ECONNREFUSED, os.strerror(errno.ECONNREFUSED))
        loop, factory, server = listens
        wire = SimulatedWire(self, next(self._numbers), address[1])
        client = ClientSocket(self, wire, address, timeout)
        transport = Transport(loop, wire, client, factory(), server)
        client.peer = transport
        self.wires.append((wire, client, transport))
        loop.call_soon_threadsafe(transport.begin)
        return client

    def socket(self, family: int = socket.AF_INET, *_: Any) -> Any:
        assert family == getattr(socket, "AF_UNIX", None), "only connections are simulated"
        return NamedLock(self)

    def select(self, reading: list[ClientSocket], writing: list[Any], seconds: float | None) -> Any:
        """Return which of the sockets have something to read; only without a wait."""
        assert not writing
        assert seconds == 0
        return [each for each in reading if each.readable], [], []

    def cut(self, client: ClientSocket, transport: Transport) -> None:
        """Break a connection, and reset both ends."""
        if client.open:
            client.reset()
        transport.reset()


class NamedLock:
    """A UNIX socket in the kernel's names, which locks a robot."""

    def __init__(self, network: Network) -> None:
        self._network, self._name, self._held = network, None, 0

    def bind(self, name: Any) -> None:
        if name in self._network.names:
            raise OSError(errno.EADDRINUSE, os.strerror(errno.EADDRINUSE))
        task = self._network.scheduler.current
        assert task is not None
        self._name, self._process = name, task.process
        self._network.names[name] = task.process
        self._held = task.process.hold(lambda: self._network.names.pop(name))

    def connect(self, name: Any) -> None:
        raise ConnectionRefusedError(errno.ECONNREFUSED, "refused")

    def listen(self, _: int = 0) -> None:
        pass

    def setblocking(self, _: bool) -> None:
        pass

    def close(self) -> None:
        if self._name is not None:
            self._network.names.pop(self._name)
            self._process.release(self._held)
            self._name = None

    def __enter__(self) -> NamedLock:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


class ClientSocket:
    """The driver's end of a wire; blocking, with a timeout."""

    def __init__(
        self, network: Network, wire: SimulatedWire, address: tuple[str, int], timeout: float | None
    ) -> None:
        self._network, self.wire, self._address, self._timeout = network, wire, address, timeout
        self.peer: Transport
        self._data: deque[bytes] = deque()
        self._waiting: list[Task] = []
        self._ended = self._reset = False
        self.open = True
        task = network.scheduler.current
        assert task is not None
        self.process = task.process
        self._held = task.process.hold(self._vanish)

    @property
    def readable(self) -> bool:
        if not self.open:
            raise ValueError("file descriptor cannot be a negative integer (-1)")
        return bool(self._data or self._ended or self._reset)

    def settimeout(self, seconds: float | None) -> None:
        if not self.open:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        self._timeout = seconds

    def gettimeout(self) -> float | None:
        return self._timeout

    def setsockopt(self, *_: Any) -> None:
        pass

    def getsockname(self) -> tuple[str, int]:
        return "127.0.0.1", 50_000 + self.wire.number

    def getpeername(self) -> tuple[str, int]:
        return self._address

    def fileno(self) -> int:
        return 1000 + self.wire.number if self.open else -1

    def sendall(self, data: bytes) -> None:
        self._network.scheduler.pause()
        self._must_be_open()
        self.wire.send(0, self.peer.arrived, bytes(data))

    def recv(self, count: int) -> bytes:
        scheduler = self._network.scheduler
        scheduler.pause()
        end = None if self._timeout is None else scheduler.now + self._timeout
        while not self._data:
            self._must_be_open()
            if self._ended:
                return b""
            left = None if end is None else end - scheduler.now
            if left is not None and left <= 0:
                if self._timeout == 0:
                    raise BlockingIOError(errno.EAGAIN, os.strerror(errno.EAGAIN))
                raise TimeoutError("timed out")
            task = scheduler.current
            assert task is not None
            self._waiting.append(task)
            scheduler.park(left)
            if task in self._waiting:
                self._waiting.remove(task)
        self._must_be_open()
        first = self._data.popleft()
        if len(first) > count:
            self._data.appendleft(first[count:])
        return first[:count]

    def _must_be_open(self) -> None:
        if not self.open:
            raise OSError(errno.EBADF, os.strerror(errno.EBADF))
        if self._reset:
            raise ConnectionResetError(errno.ECONNRESET, os.strerror(errno.ECONNRESET))

    def shutdown(self, _: int) -> None:
        self._must_be_open()
        self._ended = True
        self._wake()
        self.wire.end(0, self.peer.ended)

    def close(self) -> None:
        if self.open:
            self.open = False
            self.process.release(self._held)
            self._wake()
            if not self._reset and not self._ended:
                self.wire.end(0, self.peer.ended)

    def _vanish(self) -> None:
        """Close as the system does for a process that was killed."""
        self.open = False
        self.wire.end(0, self.peer.ended)

    # -- from the wire -------------------------------------------------------------------------------------

    def arrived(self, data: bytes) -> None:
        if self.open:
            self._data.append(data)
            self._wake()
        else:
            self.peer.reset()  # as the system answers for a socket that is closed

    def ended(self) -> None:
        self._ended = True
        self._wake()

    def reset(self) -> None:
        self._reset = True
        self._wake()

    def _wake(self) -> None:
        waiting, self._waiting = self._waiting, []
        for task in waiting:
            self._network.scheduler.wake(task)


class Transport(asyncio.Transport):
    """The device's end of a wire."""

    def __init__(
        self,
        loop: SimulatedLoop,
        wire: SimulatedWire,
        client: ClientSocket,
        protocol: Any,
        server: SimulatedServer,
    ) -> None:
        super().__init__({"peername": client.getsockname(), "sockname": ("127.0.0.1", wire.port)})
        self._loop, self.wire, self._client, self._protocol, self._server = (
            loop,
            wire,
            client,
            protocol,
            server,
        )
        self._closing = self._lost = self._paused = False
        self._kept: list[Callable[[], None]] = []

    def begin(self) -> None:
        if self.wire.port not in self.wire.network.listeners:  # closed meanwhile
            self._client.reset()
            self._lost = True
            return
        self._server.transports.add(self)
        self._protocol.connection_made(self)

    def get_protocol(self) -> Any:
        return self._protocol

    def set_protocol(self, protocol: Any) -> None:
        self._protocol = protocol

    def is_closing(self) -> bool:
        return self._closing

    def is_reading(self) -> bool:
        return not self._paused

    def pause_reading(self) -> None:
        self._paused = True

    def resume_reading(self) -> None:
        self._paused = False
        kept, self._kept = self._kept, []
        for each in kept:
            self._loop.call_soon(each)

    def set_write_buffer_limits(self, high: int | None = None, low: int | None = None) -> None:
        pass

    def get_write_buffer_size(self) -> int:
        return 0

    def write(self, data: Any) -> None:
        if not self._closing and not self._lost:
            self.wire.send(1, self._client.arrived, bytes(data) * (2 if self.wire.doubles else 1))
            self.wire.doubles = max(0, self.wire.doubles - 1)

    def can_write_eof(self) -> bool:
        return True

    def write_eof(self) -> None:
        self.wire.end(1, self._client.ended)

    def close(self) -> None:
        if not self._closing:
            self._closing = True
            self.wire.end(1, self._client.ended)
            self._loop.call_soon(self._lose, None)

    def abort(self) -> None:
        if not self._closing:
            self._closing = True
            self._client.reset()
            self._loop.call_soon(self._lose, None)

    def _lose(self, error: Exception | None) -> None:
        if not self._lost:
            self._lost = self._closing = True
            self._server.transports.discard(self)
            self._protocol.connection_lost(error)

    # -- from the wire -------------------------------------------------------------------------------------

    def _do(self, what: Callable[[], None]) -> None:
        if self._loop.is_closed():
            return
        if self._paused:
            self._kept.append(what)
        else:
            self._loop.call_soon_threadsafe(what)

    def arrived(self, data: bytes) -> None:
        self._do(lambda: None if self._lost or self._closing else self._protocol.data_received(data))

    def ended(self) -> None:
        def end() -> None:
            if not self._lost and not self._closing and not self._protocol.eof_received():
                self.close()

        self._do(end)

    def reset(self) -> None:
        if not self._loop.is_closed():
            error = ConnectionResetError(errno.ECONNRESET, os.strerror(errno.ECONNRESET))
            self._loop.call_soon_threadsafe(self._lose, error)


class _Listening:
    def __init__(self, port: int) -> None:
        self._port = port

    def getsockname(self) -> tuple[str, int]:
        return "127.0.0.1", self._port

    def fileno(self) -> int:
        return 100_000 + self._port


class SimulatedServer(asyncio.AbstractServer):
    """A port on which a loop listens."""

    def __init__(self, network: Network, port: int) -> None:
        self._network, self._port = network, port
        self.sockets = (_Listening(port),)
        self.transports: set[Transport] = set()

    def close(self) -> None:
        self._network.listeners.pop(self._port, None)

    async def wait_closed(self) -> None:
        await asyncio.sleep(0)


class _Selector:
    """Selector that waits for another task's call, or for an instant."""

    def __init__(self, scheduler: Scheduler) -> None:
        self._scheduler, self._task, self._called = scheduler, None, False

    def select(self, seconds: float | None = None) -> list[Any]:
        if not self._called and (seconds is None or seconds > 0):
            self._task = self._scheduler.current
            self._scheduler.park(seconds)
            self._task = None
        else:
            self._scheduler.pause()
        self._called = False
        return []

    def call(self) -> None:
        self._called = True
        if self._task is not None:
            self._scheduler.wake(self._task)


class SimulatedLoop(asyncio.BaseEventLoop):
    """An event loop in a task of the scheduler."""

    def __init__(self, network: Network) -> None:
        super().__init__()
        self._network = network
        self._selector = _Selector(network.scheduler)
        self._clock_resolution = 1e-9

    def time(self) -> float:
        return self._network.scheduler.now

    def _process_events(self, event_list: list[Any]) -> None:
        pass

    def _write_to_self(self) -> None:
        self._selector.call()

    def remove_reader(self, fd: Any) -> bool:
        return False

    async def create_server(self, protocol_factory: Any, host: Any = None, port: Any = None, **_: Any) -> Any:
        number = port or self._network.free_port()
        if number in self._network.listeners:
            raise OSError(errno.EADDRINUSE, os.strerror(errno.EADDRINUSE))
        server = SimulatedServer(self._network, number)
        self._network.listeners[number] = (self, protocol_factory, server)
        return server


class Policy(asyncio.DefaultEventLoopPolicy):
    """Every `asyncio.run` gets a simulated loop."""

    def __init__(self, network: Callable[[], Network]) -> None:
        super().__init__()
        self._network = network

    def new_event_loop(self) -> asyncio.AbstractEventLoop:
        return SimulatedLoop(self._network())

    def set_event_loop(self, loop: asyncio.AbstractEventLoop | None) -> None:
        pass
