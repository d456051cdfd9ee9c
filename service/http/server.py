"""Web server of the service, which no client can keep from receiving a stop.

It prints a line on standard output when it is ready, and pauses the run when it ends.

Each connection costs a file descriptor, even if no request ever comes, so their number is limited. At the limit a new
connection is accepted and another one is closed: the oldest without a complete authorised request, otherwise the oldest
event stream, otherwise the oldest. A connection without a complete header after `HEADER_S` is closed in any case.

Data of unknown clients are read in the same event loop. They queue, and one of them at a time has a short turn. Data of
a client with a known token are read at once.
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

GRACE_S = 3  # for unfinished answers when the service ends
HEADER_S = 5.0  # for a complete header, from the connection or from the previous answer
IDLE_S = 75  # idle time of a known client, after which uvicorn closes the connection
ANSWER_S = 60.0  # for the answer to an unknown client, which may read it slowly
# Limit of all connections, which keeps every descriptor below 1,024, the limit of `select`, which pyserial uses; and
# the number of them that may be event streams
MOST, STREAMS = 700, 32
_FILES, _RESERVE = (
    8192,
    256,
)  # file descriptors to request; the part of them for record, devices and workers
_AT_ONCE = 32  # connections that are accepted before one can be closed for them
_QUEUE = 1024  # connections that the system queues until they are accepted
_LOG_S = 10.0  # between two lines about connections that were closed, or two equal warnings of the server
_SHORT = 4096  # bytes of a request with a token that are read at once; further bytes wait for a turn
_TURN_S, _PIECE = 0.001, 512  # length of a turn, and the bytes between two looks at the clock
_BEARER = re.compile(rb"\r\nauthorization:[ \t]*bearer[ \t]+([!-~]+)", re.IGNORECASE)

_log = logging.getLogger("service.http.server")


def most_connections() -> int:
    """Raise the limit of open files if possible, and return the limit of connections."""
    try:
        import resource  # not on Windows, where sockets are not counted as files
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
    """Admission of connections: their number, their turns, and which one is closed at the limit.

    Parameters
    ----------
    most : int
        Limit of connections.
    clock : callable
        Monotonic time, s.
    tokens : TokenRoles
        Known tokens.
    """

    def __init__(self, most: int, clock: Callable[[], float], tokens: TokenRoles) -> None:
        self._most, self._clock, self._tokens = most, clock, tokens
        self._crowd = OrderedDict[Connection, None]()  # connections whose data wait for a turn
        # Oldest first. A connection among the strangers that has become known is moved when one has to be closed.
        self._strangers, self._known = dict[Connection, None](), dict[Connection, None]()
        self._turning = False
        self._told_s, self._closed = -math.inf, 0

    def enter(self, connection: Connection) -> None:
        """Accept a connection, and close others while there are too many."""
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
        """Forget a connection that has ended."""
        self._strangers.pop(connection, None)
        self._known.pop(connection, None)
        self._crowd.pop(connection, None)

    def knows(self, data: bytes) -> bool:
        """Return whether `data` holds the header of a request with a known token."""
        found = _BEARER.search(data)
        return found is not None and self._tokens.role_of(found[1].decode("ascii")) is not None

    def queue(self, connection: Connection) -> None:
        """Queue a connection whose data can wait for a turn."""
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
        if (
            self._turning
        ):  # after a pause as long as a turn, in which the threads of a stop get the interpreter
            asyncio.get_running_loop().call_later(_TURN_S, self._turn)

    def count_streams(self) -> None:
        """Close the oldest event stream if there are too many. Its client connects again."""
        streams = [each for each in (*self._known, *self._strangers) if each.streams]
        if len(streams) > STREAMS:
            self._close(streams[0])

    def sweep(self) -> None:
        """Close connections that sent no complete header, and unknown ones that read no answer."""
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
    """Connection that is registered at the door.

    Attributes
    ----------
    asked : bool
        Whether a complete header has been received and is not answered yet.
    streams : bool
        Whether the current answer is an event stream.
    since_s : float
        Time of the connection, the last header or the last complete answer, s on the clock of the door.
    """

    def __init__(self, door: Door, *args: Any, **options: Any) -> None:
        super().__init__(*args, **options)
        self._door, self._application = door, self.app
        self.app = self._answer
        self.asked, self.streams, self._was_known, self.since_s = False, False, False, 0.0
        self._left = bytearray()  # data that wait for a turn
        self._queued = self._answered = self._goes_on = False
        self._looking: asyncio.Task[Any] | None = None  # the current answer to a GET or HEAD request

    @property
    def known(self) -> bool:
        """Whether the current request, or the last one that was answered, had a known token."""
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
        ):  # no one receives it; a client that asks, leaves and asks again would fill the memory
            self._looking.cancel()

    def data_received(self, data: bytes) -> None:
        if not self._queued and self._at_once(data):
            super().data_received(data)
        else:
            self._left += data
            self.transport.pause_reading()
            self._queue()

    def _at_once(self, data: bytes) -> bool:
        """Return whether data are read without a turn: from a known client, and short."""
        if (
            self.known and self.conn.their_state is h11.SEND_BODY
        ):  # a body of known length is one piece, otherwise there are many
            return all(name != b"transfer-encoding" for name, _ in self.headers)
        return len(data) <= _SHORT and (self.known or self._door.knows(data))

    def _queue(self) -> None:
        if not self._queued:
            self._queued = True
            self._door.queue(self)

    def take_turn(self) -> bool:
        """Read received data for one turn; return whether some are left."""
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
        if self._answered and self.conn.trailing_data[0]:  # data after the request wait for a turn
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
            if not self.transport.is_closing():  # an error after the client has left is not reported
                raise
        finally:
            self._looking = None


class Server(uvicorn.Server):
    """Uvicorn server that prints a line at the start, pauses the run at the end, and has a door."""

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
        """Release long polls and pause the run at once, before the last connection has closed."""
        service = getattr(self._app.state, "service", None)
        if service is not None:
            order = ("service ends", SERVICE_ENDS)
            threading.Thread(target=service.book.pause_all, args=order, daemon=True).start()
            threading.Thread(target=service.end, daemon=True).start()
        # Without the inherited method, which raises the signal again in the end: the simulators must be ended first.
        self.force_exit = self.should_exit and sig == signal.SIGINT
        self.should_exit = True


class _Once(logging.Filter):
    """Log filter that drops a warning if an equal one was logged within `_LOG_S`.

    A client that sends invalid data can therefore not fill the log.
    """

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
    """Log one line, not a traceback, for a connection that could not be accepted."""
    error = context.get("exception")
    if isinstance(error, OSError) and "accept()" in context.get("message", ""):
        _log.error("A connection could not be accepted: %s.", error.strerror)
    else:
        loop.default_exception_handler(context)


def run_server(app: FastAPI, address: str, port: int, tokens: TokenRoles, hello: Callable[[str], str]) -> int:
    """Serve on a port of an address until SIGINT, SIGTERM or SIGHUP, and return an exit code.

    Parameters
    ----------
    port : int
        TCP port; 0 for a free one.
    tokens : TokenRoles
        Known tokens; requests with one of them are read before those of unknown clients.
    hello : callable
        Turns the URL of the service into the line that is printed once it is ready.

    Raises
    ------
    DataError
        The port is in use, or this program may not open it.
    OSError
        The address does not belong to this computer.
    """
    family = socket.AF_INET6 if ":" in address else socket.AF_INET
    # Without the explicit TCP, asyncio does not switch Nagle's algorithm off, and every answer takes 40 ms longer.
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
        # Objects that are loaded by now remain. Searching them for garbage holds the interpreter, and thus a stop, for
        # a tenth of a second or more. They are not even searched once, for a thousand small objects in a million.
        gc.freeze()
        gc.enable()  # `truepose serve` has had it off while it imported
        # Computing threads release the interpreter five times as often as usual, because a stop needs about ten turns.
        sys.setswitchinterval(0.001)
        server = Server(config, app, door, hello(url))
        # Closing the terminal ends the service as SIGTERM does; under `nohup` the signal is ignored.
        hang_up = getattr(signal, "SIGHUP", None)
        if hang_up is not None and signal.getsignal(hang_up) is signal.SIG_DFL:
            signal.signal(hang_up, server.handle_exit)
        server.run(sockets=[listener])
    return exit_codes.DONE if server.started else exit_codes.FAILED
