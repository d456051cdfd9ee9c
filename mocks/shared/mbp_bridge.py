"""Bridge side of an MBP/1 conversation for any instrument, with short and long commands.

Long commands are acknowledged and run concurrently with the reader, so that ABORT and PING are answered
meanwhile. There is one client; a second gets code 120. A client silent for 30 s of real time is dropped. On a
serial line, a request without a checksum is discarded like one with a wrong checksum, and a HELLO begins a new
conversation.

`STREAM on=1 rate=Hz` pushes samples until `on=0`, another HELLO or the end of the connection. A sample that the
client does not take, or that the instrument does not have, is left out together with its number. The back door
can leave a stream running for the next client, as a careless bridge does.
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Awaitable, Callable, Mapping

from mocks.shared import mbp
from mocks.shared.clock import CellClock, DeviceClock
from mocks.shared.mbp import BadRequest, pairs, value

SILENCE_S = 30.0
RATES_HZ = (0.1, 1000.0)
BACKLOG = 4096  # bytes that a client may leave unread before it misses samples
Fields = dict[str, str]


class MbpBridge:
    """One bridge with its commands.

    `short` and `long` answer commands with the text behind OK, `sample` returns a sample of a stream, and `state`
    is the state for STATUS. The first three may raise BadRequest.
    """

    def __init__(
        self,
        clock: CellClock,
        hello: str,
        state: Callable[[], str],
        short: Mapping[str, Callable[[Fields], str]],
        long: Mapping[str, Callable[[Fields], Awaitable[str]]],
        sample: Callable[[Fields], str],
    ) -> None:
        self.clock = DeviceClock(clock)
        self._hello = hello
        self._state = state
        self._table = dict(short)
        self._long = long
        self._sample = sample
        self._writer: asyncio.StreamWriter | None = None
        self._events = 0
        self._abort = asyncio.Event()
        self._changed = asyncio.Event()
        self._job: asyncio.Task[None] | None = None
        self._samples = 0
        self._stream: asyncio.Task[None] | None = None
        self._careless = False
        self.sums = True  # False: a bridge that has no checksums, and says so

    def _line(self, text: str) -> bytes:
        return mbp.line(text) if self.sums else f"{text}\n".encode()

    def t(self) -> float:
        """Return the clock that readings, events and samples carry."""
        return self.clock.now()

    def reboot(self) -> None:
        """Reset the connection; counters and clock start again."""
        self.clock.restart()
        self._events = self._samples = 0
        self.stream(None)
        if self._job is not None:
            self._job.cancel()
        if self._writer is not None:
            self._writer.transport.abort()

    # -- serving ------------------------------------------------------------------------------------------

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve one TCP client until it leaves or falls silent."""
        if self._writer is not None:
            number = (await reader.readline()).split(b" ")[0].decode("ascii", "replace")
            writer.write(self._line(f'{number} ERR code=120 text="in use" retry=1'))
            await writer.drain()
            return
        self._writer = writer
        try:
            while data := await asyncio.wait_for(reader.readline(), SILENCE_S):
                if not data.endswith(b"\n") or not await self._answer(data):
                    return
        except (TimeoutError, ValueError):
            return  # silent for too long, or a line without end
        finally:
            self._writer = None
            self._end_stream()
            await self._end_job()

    async def serve_serial(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        """Serve a serial line, which is always connected, for any client at its other end."""
        self._writer = writer
        while data := await reader.readline():
            with contextlib.suppress(ConnectionError):
                if data[-6:-5] == b"*":
                    await self._answer(data)

    async def _end_job(self) -> None:
        job, self._job = self._job, None
        if job is not None:
            job.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await job

    @property
    def busy(self) -> bool:
        return self._job is not None and not self._job.done()

    def event(self, name: str) -> None:
        """Send the client an event; a running measurement checks its conditions again."""
        self._changed.set()
        if self._writer is not None:
            self._events += 1
            self._writer.write(self._line(f"! {self._events} {name} {pairs(t=self.t())}"))

    async def wait(self, seconds: float, look: Callable[[], None]) -> None:
        """Simulated time passes; `look` is called at every change and may raise. Raises 110 on ABORT."""
        end = self.clock.cell.now() + seconds
        while (left := end - self.clock.cell.now()) > 0:
            self._changed.clear()
            if self._abort.is_set():
                raise BadRequest(110, "aborted")
            await self.clock.wait(left, self._changed)
            look()

    # -- stream -------------------------------------------------------------------------------------------

    def stream(self, fields: Fields | None, *, careless: bool = False) -> None:
        """Start pushing samples, or stop if `fields` is None.

        A `careless` stream goes to any connected client, and only this method ends it.

        Raises
        ------
        BadRequest
            103: the rate is out of range.
        """
        if self._stream is not None:
            self._stream.cancel()
            self._stream = None
        if fields is not None:
            rate = value(fields, "rate", 10.0)
            if not RATES_HZ[0] <= rate <= RATES_HZ[1]:
                raise BadRequest(103, "rate out of range")
            self._careless = careless
            self._stream = asyncio.create_task(self._push(fields, rate))

    def _end_stream(self) -> None:
        if not self._careless:
            self.stream(None)

    async def _push(self, fields: Fields, rate_hz: float) -> None:
        before = self._samples
        async for number, at_s in self.clock.ticks(1.0 / rate_hz):
            self._samples = before + number
            writer = self._writer
            if writer is None or writer.transport.get_write_buffer_size() > BACKLOG:
                continue
            with contextlib.suppress(BadRequest), self.clock.held(at_s):
                text = self._sample(fields)
                writer.write(self._line(f"# {self._samples} {pairs(t=self.t())} {text}"))

    # -- answering ----------------------------------------------------------------------------------------

    async def _answer(self, data: bytes) -> bool:
        number = 0
        try:
            parsed = mbp.request(data)
            if parsed is None:
                return True  # wrong sum: discarded, the client will time out
            number, command, fields = parsed
            if command in self._long:
                if self.busy:
                    raise BadRequest(110, "busy", retry=True)
                self._abort.clear()
                self._job = asyncio.create_task(self._run(number, self._long[command], fields))
                return True
            if command == "HELLO":
                self._end_stream()
                await self._end_job()
            reply = self._short(command, fields)
        except BadRequest as bad:
            await self._refuse(number, bad)
            return True
        await self._send(f"{number} OK {reply}".rstrip())
        return command != "BYE"

    def _short(self, command: str, fields: Fields) -> str:
        if command == "HELLO":
            if fields.get("proto") != "1":
                raise BadRequest(103, "proto=1 only")
            return self._hello if self.sums else self._hello.replace("crc=1", "crc=0")
        if command == "STATUS":
            return self._state()
        if command == "PING":
            return pairs(t=self.t())
        if command in ("CLEAR", "BYE"):
            return ""
        if command == "STREAM":
            self.stream(fields if value(fields, "on") else None)
            return ""
        if command == "ABORT":
            self._abort.set()
            self._changed.set()
            return ""
        if command in self._table:
            return self._table[command](fields)
        raise BadRequest(102, f"unknown command {command}")

    async def _run(self, number: int, act: Callable[[Fields], Awaitable[str]], fields: Fields) -> None:
        try:
            await self._send(f"{number} ACK eta=1.0")
            reply = await act(fields)
            await self._send(f"{number} OK {reply}".rstrip())
        except BadRequest as bad:
            await self._refuse(number, bad)
        except ConnectionError:
            return

    async def _refuse(self, number: int, bad: BadRequest) -> None:
        await self._send(f'{number} ERR code={bad.code} text="{bad.text}" retry={int(bad.retry)}')

    async def _send(self, text: str) -> None:
        if self._writer is not None:
            self._writer.write(self._line(text))
            await self._writer.drain()
