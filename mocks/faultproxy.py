"""A proxy between driver and simulator that spoils answers or requests, over TCP or UDP.

An answer is the data from the device up to `boundary`, or one received piece if the protocol has no boundary. A
request is one received piece. Of a protocol of datagrams, both are one datagram. Faults are chosen by name, for a
number of messages or at a rate: those of `FAULTS` hit answers, those of `REQUEST_FAULTS` hit requests. Faults that only
the device can cause (counters that start again, a clock that steps) are passed to it through `device`, an order of the
back door.
"""

from __future__ import annotations

import asyncio
import random
import socket
import threading
import time
from collections.abc import AsyncIterator, Callable
from types import TracebackType
from typing import Any

from mocks.shared.sockets import Servers, drop

GAP_S = 0.01
STEP_S = 3600.0


class Spoiler:
    """One direction of one connection, which forwards messages to `writer`.

    Each fault is a method that takes one message.
    """

    def __init__(
        self,
        writer: Any,  # an asyncio.StreamWriter, or its like for datagrams
        delay_s: float,
        rng: random.Random,
        device: Callable[..., object],
        power_off: Callable[[], None],
    ) -> None:
        self.writer = writer
        self.delay_s = delay_s
        self.rng = rng
        self.device = device
        self.power_off = power_off
        self.previous = b""
        self.held = b""
        self.silent = False

    async def send(self, data: bytes) -> None:
        if not self.silent:
            held, self.held = self.held, b""
            self.writer.write(data + held)
            await self.writer.drain()

    async def delay(self, data: bytes) -> None:
        await asyncio.sleep(self.delay_s)
        await self.send(data)

    async def drip(self, data: bytes) -> None:
        for i in range(len(data)):
            await self.send(data[i : i + 1])
            await asyncio.sleep(0.0005)

    async def split(self, data: bytes) -> None:
        await self.send(data[: len(data) // 2])
        await asyncio.sleep(GAP_S)
        await self.send(data[len(data) // 2 :])

    async def glue(self, data: bytes) -> None:
        """Repeat the answer before in one piece with this one."""
        await self.send(self.previous + data)

    async def stale(self, data: bytes) -> None:
        """Repeat the answer before instead of this one."""
        await self.send(self.previous)

    async def reorder(self, data: bytes) -> None:
        """Send this answer behind the next one."""
        self.held += data

    async def duplicate(self, data: bytes) -> None:
        await self.send(data + data)

    async def duplicate_late(self, data: bytes) -> None:
        await self.send(data)
        await asyncio.sleep(GAP_S)
        await self.send(data)

    async def drop(self, data: bytes) -> None:
        return

    async def garbage(self, data: bytes) -> None:
        await self.send(self.rng.randbytes(self.rng.randint(1, 12)) + data)

    async def flip(self, data: bytes) -> None:
        """Flip one bit of one byte."""
        at = self.rng.randrange(len(data))
        await self.send(data[:at] + bytes([data[at] ^ (1 << self.rng.randrange(7))]) + data[at + 1 :])

    async def digit(self, data: bytes) -> None:
        """Change one decimal digit, or one bit if there are no digits."""
        places = [at for at, byte in enumerate(data) if 0x30 <= byte <= 0x39]
        if not places:
            await self.flip(data)
            return
        at = self.rng.choice(places)
        other = 0x30 + (data[at] - 0x30 + self.rng.randint(1, 9)) % 10
        await self.send(data[:at] + bytes([other]) + data[at + 1 :])

    async def half(self, data: bytes) -> None:
        await self.send(data[: len(data) // 2])

    async def half_close(self, data: bytes) -> None:
        await self.half(data)
        raise ConnectionAbortedError

    async def close(self, data: bytes) -> None:
        raise ConnectionAbortedError

    async def reset(self, data: bytes) -> None:
        await self.half(data)
        raise ConnectionResetError

    async def black_hole(self, data: bytes) -> None:
        """Pass nothing more on this connection, but keep it open."""
        self.silent = True

    async def reboot(self, data: bytes) -> None:
        """Reset every connection, as a power cycle does.

        New connections are refused for a while; counters and clock start again.
        """
        self.power_off()
        raise ConnectionResetError

    async def clock_step(self, data: bytes) -> None:
        """Behind this answer the clock of the device jumps, forth or back."""
        self.device("clock_step", by_s=self.rng.choice((-STEP_S, STEP_S)))
        await self.send(data)


class DatagramSpoiler(Spoiler):
    """A direction of a client's port. Its messages are datagrams, never joined or divided."""

    async def send(self, data: bytes) -> None:
        held, self.held = self.held, b""
        for each in (data, held):
            if each and not self.silent:
                self.writer.write(each)

    async def drip(self, data: bytes) -> None:
        await self.delay(data)

    async def split(self, data: bytes) -> None:
        await self.delay(data)

    async def glue(self, data: bytes) -> None:
        await self.send(self.previous)
        await self.send(data)

    async def duplicate(self, data: bytes) -> None:
        await self.send(data)
        await self.send(data)

    async def half_close(self, data: bytes) -> None:
        self.power_off()

    async def close(self, data: bytes) -> None:
        self.power_off()

    async def reset(self, data: bytes) -> None:
        self.power_off()

    async def reboot(self, data: bytes) -> None:
        self.device("reboot")
        self.power_off()


FAULTS = (
    "delay",
    "drip",
    "split",
    "glue",
    "stale",
    "reorder",
    "duplicate",
    "duplicate_late",
    "drop",
    "garbage",
    "flip",
    "half",
    "half_close",
    "close",
    "reset",
    "black_hole",
    "reboot",
    "clock_step",
)
REQUEST_FAULTS = tuple(f"request_{name}" for name in ("digit", "flip", "half", "duplicate", "drop"))
_METHODS = {name: name.removeprefix("request_") for name in (*FAULTS, *REQUEST_FAULTS)}


class FaultProxy:
    """Proxy in a separate thread.

    Use it as `with FaultProxy(port) as proxy: proxy.spoil("half", times=1)`.
    """

    def __init__(
        self,
        device_port: int,
        *,
        boundary: bytes = b"",
        delay_s: float = 0.2,
        away_s: float = 0.1,
        seed: int = 1,
        port: int = 0,
        device: Callable[..., object] = lambda what, **order: None,
    ) -> None:
        self.device_port = device_port
        self.device = device
        self.port = port
        self.spoiled = 0
        self._boundary = boundary
        self._delay_s = delay_s
        self._away_s = away_s  # how long a reboot takes
        self._back_at = 0.0
        self._writers: set[asyncio.StreamWriter] = set()
        self._rng = random.Random(seed)
        self._plan: tuple[tuple[str, ...], int | None, float, int] = ((), 0, 1.0, 0)
        self._lock = threading.Lock()
        self._refusing = False
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()))
        self._loop: asyncio.AbstractEventLoop | None = None
        self._finish: asyncio.Event | None = None

    def spoil(self, *faults: str, times: int | None = 1, rate: float = 1.0, after: int = 0) -> None:
        """Pass `after` messages unchanged, then spoil the next `times` messages at this rate.

        With `times` None, all later messages are spoiled.
        """
        for fault in faults:
            _METHODS[fault]
        with self._lock:
            self._plan = (faults, times, rate, after)

    def heal(self) -> None:
        """End all faults; a device that is away comes back at once."""
        self.spoil(times=0)
        self._refusing = False
        self._back_at = 0.0

    def refuse(self) -> None:
        """Accept connections and close them at once, as a device that is booting does."""
        self._refusing = True

    @property
    def away(self) -> bool:
        """Whether new connections are refused."""
        return self._refusing or time.monotonic() < self._back_at

    def _power_off(self) -> None:
        self._back_at = time.monotonic() + self._away_s
        self.device("reboot")
        for writer in self._writers:
            writer.transport.abort()

    async def _pass(self, message: bytes, spoiler: Spoiler, known: tuple[str, ...]) -> None:
        """Forward one message of this direction, spoiled where it is its turn."""
        fault = self._next_fault(known)
        forward = spoiler.send if fault is None else getattr(spoiler, _METHODS[fault])
        await forward(message)

    def _next_fault(self, known: tuple[str, ...]) -> str | None:
        with self._lock:
            planned, times, rate, after = self._plan
            faults = [fault for fault in planned if fault in known]  # those of this direction
            if not faults or times == 0:
                return None
            if after > 0:
                self._plan = (planned, times, rate, after - 1)
                return None
            if self._rng.random() >= rate:
                return None
            self._plan = (planned, None if times is None else times - 1, rate, 0)
            self.spoiled += 1
            return self._rng.choice(faults)

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self.away:
            return
        device_reader, device_writer = await asyncio.open_connection("127.0.0.1", self.device_port)
        self._writers.add(writer)
        spoiler = Spoiler(writer, self._delay_s, self._rng, self.device, self._power_off)
        pumps = [
            asyncio.create_task(self._requests(reader, device_writer, spoiler)),
            asyncio.create_task(self._answers(device_reader, spoiler)),
        ]
        try:
            done, _ = await asyncio.wait(pumps, return_when=asyncio.FIRST_COMPLETED)
            if any(isinstance(task.exception(), ConnectionResetError) for task in done):
                writer.transport.abort()
        finally:
            self._writers.discard(writer)
            device_writer.close()  # before the first await: this may run while being cancelled itself
            for pump in pumps:
                pump.cancel()
            await asyncio.gather(*pumps, return_exceptions=True)
            await drop(device_writer)

    async def _requests(
        self, reader: asyncio.StreamReader, device: asyncio.StreamWriter, spoiler: Spoiler
    ) -> None:
        to_device = Spoiler(device, self._delay_s, self._rng, self.device, self._power_off)
        while data := await reader.read(4096):
            if not spoiler.silent:
                await self._pass(data, to_device, REQUEST_FAULTS)

    async def _answers(self, device: asyncio.StreamReader, spoiler: Spoiler) -> None:
        async for message in self._messages(device):
            await self._pass(message, spoiler, FAULTS)
            spoiler.previous = message

    async def _messages(self, device: asyncio.StreamReader) -> AsyncIterator[bytes]:
        if not self._boundary:
            while data := await device.read(4096):
                yield data
            return
        while True:
            try:
                yield await device.readuntil(self._boundary)
            except asyncio.IncompleteReadError:
                return

    async def _main(self) -> None:
        self._loop, self._finish = asyncio.get_running_loop(), asyncio.Event()
        servers = Servers()
        try:
            self.port = await servers.listen(self._serve, self.port)
        finally:
            self._ready.set()
        await self._finish.wait()
        await servers.close()

    def __enter__(self) -> FaultProxy:
        self._thread.start()
        self._ready.wait()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._loop is not None
        assert self._finish is not None
        self._loop.call_soon_threadsafe(self._finish.set)
        self._thread.join()


CLIENTS = 16  # ports of clients that a proxy of datagrams remembers
_NOBODY = ("127.0.0.1", 9)


class _Datagrams(asyncio.DatagramProtocol):
    """Hands each datagram on with its sender; a port that refuses is ignored."""

    def __init__(self, take: Callable[[bytes, Any], None]) -> None:
        self._take = take

    def datagram_received(self, data: bytes, addr: Any) -> None:
        self._take(data, addr)


class _DatagramWriter:
    """Sends datagrams, as the spoiler of a stream writes bytes."""

    def __init__(self, transport: Callable[[], Any], address: Any = None) -> None:
        self._transport = transport
        self._address = address

    def write(self, data: bytes) -> None:
        if (transport := self._transport()) is not None:
            transport.sendto(data, self._address)


class DatagramProxy(FaultProxy):
    """A proxy of datagrams; each port of a client counts as one connection.

    Where a connection would be closed, the proxy closes its port for `away_s` or until `heal`. The network reports that
    to a client that sends there.
    """

    def __init__(self, device_port: int, *, away_s: float = 1.5, **options: Any) -> None:
        super().__init__(device_port, away_s=away_s, **options)
        self._flows: dict[Any, tuple[asyncio.Queue[bytes], asyncio.Task[None]]] = {}
        self._guard = _bound(self.port)  # keeps the port while it is closed
        self._guard.connect(_NOBODY)
        self.port = int(self._guard.getsockname()[1])
        self._door: Any = None
        self._opening: asyncio.TimerHandle | None = None

    @property
    def away(self) -> bool:
        return self._door is None

    def heal(self) -> None:
        super().heal()
        assert self._loop is not None
        asyncio.run_coroutine_threadsafe(self._open(), self._loop).result(10)

    def refuse(self) -> None:
        super().refuse()
        assert self._loop is not None
        asyncio.run_coroutine_threadsafe(self._shut(), self._loop).result(10)

    async def _shut(self) -> None:
        door, self._door = self._door, None
        if door is not None:
            door.abort()
            await asyncio.sleep(0)  # closed in the next turn of the loop

    async def _open(self) -> None:
        assert self._loop is not None
        if self._opening is not None:
            self._opening.cancel()
        if self._door is None:
            self._door, _ = await self._loop.create_datagram_endpoint(
                lambda: _Datagrams(self._forward), sock=_bound(self.port)
            )

    def _close_port(self) -> None:
        assert self._loop is not None
        if self._door is not None:
            self._door.abort()
        self._door = None
        self._opening = self._loop.call_later(self._away_s, lambda: asyncio.ensure_future(self._open()))

    def _forward(self, data: bytes, client: Any) -> None:
        if client not in self._flows:
            requests: asyncio.Queue[bytes] = asyncio.Queue()
            self._flows[client] = requests, asyncio.ensure_future(self._flow(client, requests))
            if len(self._flows) > CLIENTS:
                oldest = next(iter(self._flows))
                self._flows.pop(oldest)[1].cancel()
        self._flows[client][0].put_nowait(data)

    async def _flow(self, client: Any, requests: asyncio.Queue[bytes]) -> None:
        """Forward the datagrams of one client's port, both ways."""
        assert self._loop is not None
        answers: asyncio.Queue[bytes] = asyncio.Queue()
        device, _ = await self._loop.create_datagram_endpoint(
            lambda: _Datagrams(lambda data, _: answers.put_nowait(data)),
            remote_addr=("127.0.0.1", self.device_port),
        )

        def spoiler(writer: _DatagramWriter) -> DatagramSpoiler:
            return DatagramSpoiler(writer, self._delay_s, self._rng, self.device, self._close_port)

        back, forth = (
            spoiler(_DatagramWriter(lambda: self._door, client)),
            spoiler(_DatagramWriter(lambda: device)),
        )

        async def answered() -> None:
            while True:
                message = await answers.get()
                await self._pass(message, back, FAULTS)
                back.previous = message

        pump = asyncio.create_task(answered())
        try:
            while True:
                request = await requests.get()
                if not back.silent:
                    await self._pass(request, forth, REQUEST_FAULTS)
        finally:
            pump.cancel()
            device.close()

    async def _main(self) -> None:
        self._loop, self._finish = asyncio.get_running_loop(), asyncio.Event()
        try:
            await self._open()
        finally:
            self._ready.set()
        await self._finish.wait()
        await self._shut()
        self._guard.close()
        tasks = [task for _, task in self._flows.values()]
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)


def _bound(port: int) -> socket.socket:
    """Return a socket on a port, which others of this proxy may share; 0 is a free one."""
    sock = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    sock.setsockopt(socket.SOL_SOCKET, getattr(socket, "SO_REUSEPORT", socket.SO_REUSEADDR), 1)
    sock.bind(("127.0.0.1", port))
    return sock
