"""The server: its line on standard output, the pause at its end, and a door that nobody can block for a stop.

A connection costs a file descriptor, whoever holds it and whether or not a request ever comes. So there is a cap on all
of them; who comes when it is reached is let in, and another goes: the oldest that has sent no complete authorised
request, else the oldest stream of events, else the oldest. Whoever sends no complete header within seconds goes anyway.

What strangers send is read in the one event loop, too, so they queue: one of them has a turn at a time, a short one.
Whoever comes with a token that is known is read at once.
"""

from __future__ import annotations

import asyncio
import errno
import gc
import logging
import math
import re
import signal
import socket
import sys
import threading
import time
from collections import OrderedDict
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from types import FrameType
from typing import Any, cast

import h11
import uvicorn
from fastapi import FastAPI
from starlette.types import Message, Receive, Scope, Send
from uvicorn.protocols.http.h11_impl import H11Protocol

from calib.errors import DataError
from service import exit_codes
from service.http.access.gate import TokenRoles
from service.http.runs.run_manager import SERVICE_ENDS

GRACE_S = 3  # for answers under way when the service ends
HEADER_S = 5.0  # for a complete header, from the connection or from the answer before
IDLE_S = 75  # that whoever is known may ask nothing; uvicorn closes the connection then
ANSWER_S = 60.0  # for the answer to somebody unknown, who may read it slowly
# Connections in all, so many that every descriptor stays below the 1,024 that `select` takes, as pyserial uses it; and
# those of them that may be streams of events
MOST, STREAMS = 700, 32
_FILES, _RESERVE = (
    8192,
    256,
)  # file descriptors that are asked for; those of them for record, devices, workers
_AT_ONCE = 32  # connections that are accepted before one can be closed to make room
_QUEUE = 1024  # connections that the system holds until they are accepted
_LOG_S = 10.0  # between two lines about connections that were closed, or two equal warnings of the server
_SHORT = 4096  # bytes of a request with a token that are read at once; what comes after them waits for a turn
_TURN_S, _PIECE = 0.001, 512  # a turn, and the bytes of it after which the clock is looked at
_BEARER = re.compile(rb"\r\nauthorization:[ \t]*bearer[ \t]+([!-~]+)", re.IGNORECASE)

_log = logging.getLogger("service.http.server")


def most_connections() -> int:
    """The cap on connections, after the limit of open files was raised as far as the system lets it be."""
    try:
        import resource  # not on Windows, where sockets are not counted so
    except ImportError:
        return MOST
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    most = _FILES if hard == resource.RLIM_INFINITY else min(_FILES, hard)
    if soft != resource.RLIM_INFINITY and soft < most:
        with suppress(ValueError, OSError):
            resource.setrlimit(resource.RLIMIT_NOFILE, (most, hard))
        soft = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    left = MOST if soft == resource.RLIM_INFINITY else soft - min(_RESERVE, soft // 2) - _AT_ONCE
    return max(8, min(MOST, left))


class Door:
    """Who is connected, whose turn it is, and who goes when there are too many. tokens: those that are known."""

    def __init__(self, most: int, clock: Callable[[], float], tokens: TokenRoles) -> None:
        self._most, self._clock, self._tokens = most, clock, tokens
        self._crowd = OrderedDict[Connection, None]()  # those with data that wait for a turn
        # Oldest first; who is met there as known by now is moved on when room is made
        self._strangers, self._known = dict[Connection, None](), dict[Connection, None]()
        self._turning = False
        self._told_s, self._closed = -math.inf, 0

    def enter(self, connection: Connection) -> None:
        """Let a connection in; where there are too many now, another goes."""
        connection.since_s = self._clock()
        self._strangers[connection] = None
        while len(self._strangers) + len(self._known) > self._most:
            oldest = next(iter(self._strangers))
            if oldest is connection:
                streams = (each for each in self._known if each.streams)
                self._close(next(streams, next(iter(self._known))))
            elif oldest.known:
                self._known[oldest] = self._strangers.pop(oldest)
            else:
                self._close(oldest)

    def leave(self, connection: Connection) -> None:
        """A connection that has ended."""
        self._strangers.pop(connection, None)
        self._known.pop(connection, None)
        self._crowd.pop(connection, None)

    def knows(self, data: bytes) -> bool:
        """Whether a token in the header of a request that came with `data` is known."""
        found = _BEARER.search(data)
        return found is not None and self._tokens.role_of(found[1].decode("ascii")) is not None

    def queue(self, connection: Connection) -> None:
        """A connection has data that can wait: it has a turn after those that came before."""
        self._crowd[connection] = None
        if not self._turning:
            self._turning = True
            asyncio.get_running_loop().call_soon(self._turn)

    def _turn(self) -> None:
        if self._crowd:
            first, _ = self._crowd.popitem(last=False)
            if first.take_turn():
                self._crowd[first] = None
        self._turning = bool(self._crowd)
        if self._turning:  # a pause as long as a turn, in which the threads of a stop have the interpreter
            asyncio.get_running_loop().call_later(_TURN_S, self._turn)

    def count_streams(self) -> None:
        """A stream of events has begun: where there are too many, the oldest goes, whose client asks again."""
        streams = [each for each in (*self._known, *self._strangers) if each.streams]
        if len(streams) > STREAMS:
            self._close(streams[0])

    def sweep(self) -> None:
        """Close whoever has sent no complete header for seconds, and whoever is unknown and does not read."""
        now = self._clock()
        for each in (*self._known, *self._strangers):
            if each.asked:
                patience = math.inf if each.known else ANSWER_S
            else:
                patience = 2.0 * IDLE_S if each.known else HEADER_S
            if now - each.since_s > patience:
                self._close(each)

    def _close(self, connection: Connection) -> None:
        self.leave(connection)
        connection.transport.abort()
        self._closed += 1
        now = self._clock()
        if now - self._told_s >= _LOG_S:
            _log.warning(
                "%d connections that sent nothing, or beyond the %d that are held, were closed.",
                self._closed,
                self._most,
            )
            self._told_s, self._closed = now, 0


class Connection(H11Protocol):
    """A connection that the door knows of. asked: whether a complete header has come that is not answered yet."""

    def __init__(self, door: Door, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._door, self._application = door, self.app
        self.app = self._answer
        self.asked, self.streams, self._was_known, self.since_s = False, False, False, 0.0
        self._left = bytearray()  # that came and waits for a turn
        self._queued = self._answered = self._goes_on = False
        self._looking: asyncio.Task[Any] | None = None  # the answer under way to a GET

    @property
    def known(self) -> bool:
        """Whether a request came with a token that is known, the one under way or the last that was answered."""
        return self._was_known or self._has_role

    @property
    def _has_role(self) -> bool:
        return self.scope is not None and self.scope.get("state", {}).get("role") is not None

    def connection_made(self, transport: asyncio.Transport) -> None:
        super().connection_made(transport)
        self._door.enter(self)

    def connection_lost(self, exc: Exception | None) -> None:
        self._door.leave(self)
        super().connection_lost(exc)
        if (
            self._looking is not None
        ):  # nobody hears it; whoever asks, goes and asks again would fill the memory
            self._looking.cancel()

    def data_received(self, data: bytes) -> None:
        if not self._queued and self._at_once(data):
            super().data_received(data)
        else:
            self._left += data
            self.transport.pause_reading()
            self._queue()

    def _at_once(self, data: bytes) -> bool:
        """Whether data need no turn: of somebody known, and no more than a moment's work."""
        if (
            self.known and self.conn.their_state is h11.SEND_BODY
        ):  # of a known length it is one piece, else many
            return all(name != b"transfer-encoding" for name, _ in self.headers)
        return len(data) <= _SHORT and (self.known or self._door.knows(data))

    def _queue(self) -> None:
        if not self._queued:
            self._queued = True
            self._door.queue(self)

    def take_turn(self) -> bool:
        """Read for a moment what has come; whether some is left."""
        end = time.monotonic() + _TURN_S
        if self._goes_on and not self.transport.is_closing():
            super().handle_events()
        self._goes_on = False
        while self._left and not self.transport.is_closing() and time.monotonic() < end:
            piece = bytes(self._left[:_PIECE])
            del self._left[:_PIECE]
            super().data_received(piece)
        if self.transport.is_closing():
            self._left.clear()
        elif not self._left and not self.flow.read_paused:
            self.transport.resume_reading()
        self._queued = bool(self._left) or self._goes_on
        return self._queued

    def handle_events(self) -> None:
        if self._answered and self.conn.trailing_data[0]:  # what came behind the request waits for a turn
            self._goes_on = True
            self._queue()
        else:
            super().handle_events()

    def on_response_complete(self) -> None:
        self.asked, self.streams, self.since_s = False, False, time.monotonic()
        self._was_known = self._has_role
        self._answered = True
        super().on_response_complete()
        self._answered = False

    async def _answer(self, scope: Scope, receive: Receive, send: Send) -> None:
        self.asked, self.since_s = True, time.monotonic()

        async def sent(message: Message) -> None:
            if message["type"] == "http.response.start":
                kind = dict(message.get("headers", ())).get(b"content-type", b"")
                if kind.startswith(b"text/event-stream"):
                    self.streams = True
                    self._door.count_streams()
            await send(message)

        self._looking = asyncio.current_task() if scope["method"] in ("GET", "HEAD") else None
        try:
            await self._application(scope, receive, sent)
        except (Exception, asyncio.CancelledError):
            if not self.transport.is_closing():  # what fails because nobody is there any more is no news
                raise
        finally:
            self._looking = None


class Server(uvicorn.Server):
    """Uvicorn, with a line at the start, a pause at the end and a door."""

    def __init__(self, config: uvicorn.Config, app: FastAPI, door: Door, hello: str) -> None:
        super().__init__(config)
        self._app, self._door, self._hello = app, door, hello

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        asyncio.get_running_loop().set_exception_handler(_quietly)
        await super().startup(sockets)
        for listener in sockets or ():
            listener.listen(_QUEUE)  # asyncio accepts no more at once than it was told to queue
        if self.started:
            sys.stdout.write(self._hello + "\n")
            sys.stdout.flush()

    async def on_tick(self, counter: int) -> bool:
        if counter % 10 == 0:
            self._door.sweep()
        return await super().on_tick(counter)

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Long polls are let go and the run is paused at once, not after the last connection has closed."""
        service = getattr(self._app.state, "service", None)
        if service is not None:
            order = ("service ends", SERVICE_ENDS)
            threading.Thread(target=service.book.pause_all, args=order, daemon=True).start()
            threading.Thread(target=service.end, daemon=True).start()
        # Not by the method above us, which raises the signal again in the end: the simulators must be ended first.
        self.force_exit = self.should_exit and sig == signal.SIGINT
        self.should_exit = True


class _Once(logging.Filter):
    """Lets a warning pass unless an equal one was told a moment ago: whoever sends nonsense fills no log."""

    def __init__(self, clock: Callable[[], float]) -> None:
        super().__init__()
        self._clock, self._told_s = clock, dict[str, float]()

    def filter(self, record: logging.LogRecord) -> bool:
        now, text = self._clock(), str(record.msg)
        if record.levelno != logging.WARNING or now - self._told_s.get(text, -math.inf) >= _LOG_S:
            self._told_s[text] = now
            return True
        return False


def _quietly(loop: asyncio.AbstractEventLoop, context: dict[str, Any]) -> None:
    """One line, not a traceback, for a connection that could not be accepted."""
    error = context.get("exception")
    if isinstance(error, OSError) and "accept()" in context.get("message", ""):
        _log.error("A connection could not be accepted: %s.", error.strerror)
    else:
        loop.default_exception_handler(context)


def run_server(app: FastAPI, address: str, port: int, tokens: TokenRoles, hello: Callable[[str], str]) -> int:
    """Serve on a port of an address until SIGINT, SIGTERM or SIGHUP; an exit code. hello: what to print once it is
    ready, from its URL; tokens: with which a request is read before those of strangers.

    Raises DataError when the port is taken, OSError for an address that is not of this computer.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    # Named as TCP, or asyncio does not switch Nagle's algorithm off and every answer takes 40 ms longer.
    with socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP) as listener:
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            listener.bind((address.strip("[]"), port))
        except OSError as error:
            if error.errno not in (errno.EADDRINUSE, errno.EACCES):
                raise
            raise DataError(
                f"{port} of {address} cannot be opened: {error.strerror}.",
                do="Give another one, or 0 for a free one; another service may be running there.",
                key="--port",
            ) from error
        host = f"[{address.strip('[]')}]" if family == socket.AF_INET6 else address
        url = f"http://{host}:{listener.getsockname()[1]}"
        door = Door(most_connections(), time.monotonic, tokens)
        config = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=GRACE_S,
            timeout_keep_alive=IDLE_S,
            backlog=_AT_ONCE,
            ws="none",
            http=cast("type[asyncio.Protocol]", partial(Connection, door)),
        )
        logging.getLogger("uvicorn.error").addFilter(_Once(time.monotonic))
        # What is loaded by now stays: looking through it for garbage holds the interpreter for a tenth of a second or
        # more, and a stop with it. Nor is it looked through once, for a thousand small objects of a million.
        gc.freeze()
        gc.enable()  # `truepose serve` has had it off while it imported
        # Threads that compute give the interpreter up five times as often as usual: a stop takes some ten turns.
        sys.setswitchinterval(0.001)
        server = Server(config, app, door, hello(url))
        # A terminal that is closed ends the service as SIGTERM does; `nohup` has it ignored.
        hang_up = getattr(signal, "SIGHUP", None)
        if hang_up is not None and signal.getsignal(hang_up) is signal.SIG_DFL:
            signal.signal(hang_up, server.handle_exit)
        server.run(sockets=[listener])
    return exit_codes.DONE if server.started else exit_codes.FAILED
