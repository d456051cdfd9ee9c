"""A custom proxy that loses and doubles requests between cells and the server of a fleet.

It draws a fate for every request:

    request lost    it never arrives; the connection ends
    answer lost     it arrives, its answer does not; the connection ends
    doubled         it arrives twice, one after the other; the answer is that of the second
    doubled late    it arrives, and once more after some others have

`away` is a server that has not been started again yet: then connections end at once.
"""

from __future__ import annotations

import http.client
import random
import threading
from collections import Counter, deque
from collections.abc import Iterator
from contextlib import contextmanager
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

FATES = ("request lost", "answer lost", "doubled", "doubled late")
LATE = 5  # requests later
TIMEOUT_S = 120.0
_Request = tuple[str, str, dict[str, str], bytes]


class Lossy:
    """Proxy that loses and doubles requests.

    It listens on `port` and leads to the port `server`, or to no server if that is None. `fates` counts how often each
    fate was drawn.
    """

    def __init__(self, server: int | None, rate: float, seed: int) -> None:
        self.server = server
        self.fates: Counter[str] = Counter()
        self._rate, self._chance = rate, random.Random(seed)
        self._late: deque[tuple[int, _Request]] = deque()
        self._lock = threading.Lock()
        self._http = ThreadingHTTPServer(("127.0.0.1", 0), self._handler())
        self.port: int = self._http.server_port
        self._thread = threading.Thread(target=self._http.serve_forever, kwargs={"poll_interval": 0.05})
        self._thread.start()

    @property
    def requests(self) -> int:
        """Number of requests so far."""
        return self.fates.total()

    def close(self) -> None:
        """Stop the proxy."""
        self._http.shutdown()
        self._http.server_close()
        self._thread.join()

    def _draw(self, request: _Request) -> tuple[str, list[_Request]]:
        """Return the fate of a request, and the earlier requests that arrive again now."""
        with self._lock:
            fate = self._chance.choice(FATES) if self._chance.random() < self._rate else "whole"
            self.fates[fate] += 1
            again = []
            while self._late and self._late[0][0] <= self.requests:
                again.append(self._late.popleft()[1])
            if fate == "doubled late":
                self._late.append((self.requests + LATE, request))
        return fate, again

    def _ask(self, request: _Request) -> tuple[int, dict[str, str], bytes]:
        """Send a request to the server and return its answer.

        Without an answer, it raises OSError or HTTPException.
        """
        if self.server is None:
            raise ConnectionError("there is no server")
        method, path, headers, body = request
        link = http.client.HTTPConnection("127.0.0.1", self.server, timeout=TIMEOUT_S)
        try:
            link.request(method, path, body, headers)
            answer = link.getresponse()
            data = answer.read()
        finally:
            link.close()
        return answer.status, dict(answer.getheaders()), data

    def _handler(self) -> type[BaseHTTPRequestHandler]:
        proxy = self

        class Handler(BaseHTTPRequestHandler):
            protocol_version = "HTTP/1.1"
            disable_nagle_algorithm = True

            def log_message(self, format: str, *args: Any) -> None:
                """Nothing."""

            def do_PUT(self) -> None:
                body = self.rfile.read(int(self.headers.get("Content-Length", "0")))
                request = ("PUT", self.path, {**self.headers, "Host": "127.0.0.1"}, body)
                fate, again = proxy._draw(request)
                try:
                    for each in again:
                        proxy._ask(each)
                    if fate == "request lost":
                        raise ConnectionError("lost")
                    if fate == "doubled":
                        proxy._ask(request)
                    status, headers, data = proxy._ask(request)
                    if fate == "answer lost":
                        raise ConnectionError("lost")
                except (OSError, http.client.HTTPException):
                    self.close_connection = True
                    return
                self.send_response(status)
                for name in ("Content-Type", "Retry-After"):
                    if name.lower() in {key.lower() for key in headers}:
                        self.send_header(name, {k.lower(): v for k, v in headers.items()}[name.lower()])
                self.send_header("Content-Length", str(len(data)))
                self.end_headers()
                self.wfile.write(data)

        return Handler


@contextmanager
def lossy(server: int | None, rate: float = 0.3, seed: int = 1) -> Iterator[Lossy]:
    """The proxy until the block ends."""
    proxy = Lossy(server, rate, seed)
    try:
        yield proxy
    finally:
        proxy.close()
