"""The server says where it is on standard output, and pauses a campaign as soon as it is asked to end."""

from __future__ import annotations

import errno
import gc
import signal
import socket
import sys
import threading
from collections.abc import Callable
from types import FrameType

import uvicorn
from fastapi import FastAPI

from calib.errors import DataError
from service import exit_codes
from service.http.runs.book import SERVICE_ENDS

GRACE_S = 3  # for answers under way when the service ends


class Server(uvicorn.Server):
    """Uvicorn, with a line at the start and a pause at the end."""

    def __init__(self, config: uvicorn.Config, app: FastAPI, hello: str) -> None:
        super().__init__(config)
        self._app, self._hello = app, hello

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            sys.stdout.write(self._hello + "\n")
            sys.stdout.flush()

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


def run_server(app: FastAPI, address: str, port: int, hello: Callable[[str], str]) -> int:
    """Serve on a port of an address until SIGINT, SIGTERM or SIGHUP; an exit code. hello: what to print once it is
    ready, from its URL.

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
        config = uvicorn.Config(
            app,
            log_level="warning",
            access_log=False,
            server_header=False,
            timeout_graceful_shutdown=GRACE_S,
        )
        # What is loaded by now stays: looking through it for garbage holds the interpreter for a tenth of a second or
        # more, and a stop with it. Nor is it looked through once, for a thousand small objects of a million.
        gc.freeze()
        gc.enable()  # `truepose serve` has had it off while it imported
        # Threads that compute give the interpreter up five times as often as usual: a stop takes some ten turns.
        sys.setswitchinterval(0.001)
        server = Server(config, app, hello(url))
        # A terminal that is closed ends the service as SIGTERM does; `nohup` has it ignored.
        hang_up = getattr(signal, "SIGHUP", None)
        if hang_up is not None and signal.getsignal(hang_up) is signal.SIG_DFL:
            signal.signal(hang_up, server.handle_exit)
        server.run(sockets=[listener])
    return exit_codes.DONE if server.started else exit_codes.FAILED
