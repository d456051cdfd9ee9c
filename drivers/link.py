"""The TCP byte link that all drivers use.

One rule makes late, split, glued, duplicated and half answers harmless: **any fault closes the link**. An
answer can then never be taken for that to another question, because its connection is closed. The
other rules: nothing unread before asking, one question outstanding, an answer ends at its exact terminator
(half a line at the end of the stream is an error), every wait has a deadline with a name.
"""

from __future__ import annotations

import json
import re
import select
import socket
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from typing import Protocol, TextIO
from urllib.parse import parse_qsl, urlsplit

from drivers.errors import ConfigError, LinkError, LinkLost, LinkTimeout, ProtocolError

_CHUNK = 4096
_CLOSED = "Cable and power are in order: start the program that listens there, or correct the port."
_HOST = re.compile(r"[A-Za-z0-9_.:-]+")


class WireSink(Protocol):
    """A receiver of every byte that is sent or received, for the record."""

    def record(self, device: str, direction: str, data: bytes) -> None: ...


class WireLog:
    """A wire log that writes JSON lines of t_s, device, dir (`>` to the device, `<` from it, `!` opened, closed) and
    data.

    `data` is latin-1 text, so that every byte survives the round trip. Time in seconds of the clock given.
    """

    def __init__(self, stream: TextIO, clock: Callable[[], float] = time.time) -> None:
        self._stream = stream
        self.clock = clock
        self._lock = threading.Lock()

    def record(self, device: str, direction: str, data: bytes) -> None:
        row = {
            "t_s": round(self.clock(), 6),
            "device": device,
            "dir": direction,
            "data": data.decode("latin-1"),
        }
        with self._lock:
            self._stream.write(json.dumps(row) + "\n")


@dataclass(frozen=True, slots=True)
class Address:
    """Host and port of a device, with the options of its URL (`?background=5002`)."""

    host: str
    port: int
    options: Mapping[str, str] = field(default_factory=dict)


def beside(address: Address, option: str, port: int, device: str) -> Address:
    """The address of the same controller with the port of the option, else `port`. Raises ConfigError."""
    text = address.options.get(option, str(port))
    if not text.isdecimal() or not 0 < int(text) < 65536:
        raise ConfigError(f"{option}={text!r} is not a port", device=device)
    return replace(address, port=int(text))


def parse_url(url: str) -> Address:
    """`tcp://host:port[?key=value]` as an Address. Raises ConfigError naming the part that is wrong."""
    parts = urlsplit(url)
    if parts.scheme != "tcp":
        raise ConfigError(f"address {url!r} must begin with tcp://")
    try:
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ConfigError(f"address {url!r}: {error}") from error
    if not host or not _HOST.fullmatch(host) or parts.path not in ("", "/") or parts.username:
        raise ConfigError(f"address {url!r} must have the form tcp://host:port")
    if not port:
        raise ConfigError(f"address {url!r} has no port")
    return Address(host, port, dict(parse_qsl(parts.query)))


class TcpLink:
    """A TCP connection to a device. Not shared between threads, except `close`, which is always safe.

    `clock`: returns s; all deadlines on this link are measured by it. `enabled_at`: where a person opens its port.
    """

    poll_s = 0.1  # how often a waiting question looks at its `meanwhile`

    def __init__(
        self,
        address: Address,
        device: str,
        *,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
        enabled_at: str = "",
    ) -> None:
        self.address = address
        self._enabled_at = enabled_at
        self.device = device
        self.wire = wire
        self.clock = clock
        self._socket: socket.socket | None = None
        self._buffer = b""

    @property
    def is_open(self) -> bool:
        return self._socket is not None

    def open(self, *, connect_s: float) -> None:
        """Connect anew. Raises LinkTimeout or LinkLost."""
        self.close()
        where = f"{self.address.host}:{self.address.port}"
        try:
            self._socket = socket.create_connection((self.address.host, self.address.port), timeout=connect_s)
        except TimeoutError as error:
            raise LinkTimeout(
                f"{where} did not accept within connect = {connect_s:g} s",
                device=self.device,
                command="connect",
                what_to_do=LinkError.advice,  # nothing there says a word, not even no
            ) from error
        except ConnectionRefusedError as error:
            raise LinkLost(
                f"{where} not reachable: the device answers, its port is closed",
                device=self.device,
                command="connect",
                what_to_do=" ".join(filter(None, (_CLOSED, self._enabled_at))),
            ) from error
        except OSError as error:
            raise LinkLost(
                f"{where} not reachable: {_words(error)}", device=self.device, command="connect"
            ) from error
        self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._log("!", b"open " + where.encode())

    def close(self) -> None:
        """Close; never raises, may be called at any time and from any thread."""
        sock, self._socket = self._socket, None
        self._buffer = b""
        if sock is not None:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)  # wakes a reader in another thread
            sock.close()
            self._log("!", b"close")

    @contextmanager
    def question(self, command: str, *, unread_allowed: bool = False) -> Iterator[None]:
        """A context manager from the question to the parsed answer: any exception in it closes the link.

        `unread_allowed` is for protocols whose device may speak unasked (events) and whose answers carry the
        number of their question.
        """
        try:
            if not unread_allowed:
                self._nothing_unread(command)
            yield
        except BaseException:
            self.close()
            raise

    def send(self, data: bytes, *, command: str, send_s: float) -> None:
        """Send all bytes. Raises LinkTimeout or LinkLost."""
        sock = self._open_socket(command)
        self._log(">", data)
        try:
            sock.settimeout(send_s)
            sock.sendall(data)
        except TimeoutError as error:
            raise LinkTimeout(
                f"request not taken within send = {send_s:g} s", device=self.device, command=command
            ) from error
        except OSError as error:
            raise LinkLost(
                f"connection lost: {_words(error)}", device=self.device, command=command
            ) from error

    def read_until(
        self,
        terminator: bytes,
        *,
        command: str,
        deadline: str,
        seconds: float,
        limit: int = 512,
        meanwhile: Callable[[], None] | None = None,
    ) -> bytes:
        """Bytes up to and without the terminator; the rest stays for the next call.

        `meanwhile` is called every `poll_s` while waiting and may raise. Raises LinkTimeout (naming the
        deadline), LinkLost (also at the end of the stream with half a line), ProtocolError (line too long).
        """
        end = self.clock() + seconds
        while terminator not in self._buffer:
            if len(self._buffer) > limit:
                raise ProtocolError(
                    f"no end of line within {limit} bytes",
                    device=self.device,
                    command=command,
                    raw=self._buffer,
                )
            self._fill(command, deadline, seconds, end, meanwhile)
        line, self._buffer = self._buffer.split(terminator, 1)
        if len(line) > limit:
            raise ProtocolError(
                f"line longer than {limit} bytes", device=self.device, command=command, raw=line
            )
        return line

    def read_exactly(
        self,
        count: int,
        *,
        command: str,
        deadline: str,
        seconds: float,
        meanwhile: Callable[[], None] | None = None,
    ) -> bytes:
        """The next `count` bytes, for protocols that count; the rest stays. Raises LinkTimeout, LinkLost."""
        end = self.clock() + seconds
        while len(self._buffer) < count:
            self._fill(command, deadline, seconds, end, meanwhile)
        data, self._buffer = self._buffer[:count], self._buffer[count:]
        return data

    def read_reply(
        self,
        complete: re.Pattern[bytes],
        *,
        command: str,
        deadline: str,
        seconds: float,
        possible: Callable[[bytes], bool],
        quiet_s: float = 0.0,
        sure: re.Pattern[bytes] | None = None,
        meanwhile: Callable[[], None] | None = None,
    ) -> re.Match[bytes]:
        """An answer without a terminator: all bytes received must match `complete` exactly.

        `possible` says whether the bytes so far can still become an answer. Free text has no recognisable
        end: with `quiet_s` it ends when nothing more came for so long, unless it has the form `sure`. Raises like
        `read_until`.
        """
        end = self.clock() + seconds
        while not (found := complete.fullmatch(self._buffer)) or (
            not (sure and sure.fullmatch(self._buffer)) and self._more_within(quiet_s, command)
        ):
            if found:
                continue
            if not possible(self._buffer):
                raise ProtocolError(
                    "answer to another question, or not an answer",
                    device=self.device,
                    command=command,
                    raw=self._buffer,
                )
            self._fill(command, deadline, seconds, end, meanwhile)
        self._buffer = b""
        return found

    def _nothing_unread(self, command: str) -> None:
        sock = self._open_socket(command)
        try:
            if not self._buffer and select.select([sock], [], [], 0)[0]:
                sock.settimeout(0)
                self._take(sock.recv(_CHUNK), command)
        except (OSError, ValueError) as error:
            raise LinkLost(
                f"connection lost: {_words(error)}", device=self.device, command=command
            ) from error
        if self._buffer:
            raise ProtocolError(
                "bytes that nobody asked for", device=self.device, command=command, raw=self._buffer
            )

    def _more_within(self, quiet_s: float, command: str) -> bool:
        if quiet_s <= 0:
            return False
        sock = self._open_socket(command)
        sock.settimeout(quiet_s)
        try:
            data = sock.recv(_CHUNK)
        except TimeoutError:
            return False
        except OSError as error:
            raise LinkLost(
                f"connection lost: {_words(error)}", device=self.device, command=command
            ) from error
        self._take(data, command)
        return True

    def _fill(
        self,
        command: str,
        deadline: str,
        seconds: float,
        end: float,
        meanwhile: Callable[[], None] | None,
    ) -> None:
        sock = self._open_socket(command)
        left = end - self.clock()
        if left <= 0:
            raise LinkTimeout(
                f"no complete answer within {deadline} = {seconds:.3g} s",
                device=self.device,
                command=command,
                raw=self._buffer,
            )
        try:
            sock.settimeout(left if meanwhile is None else min(left, self.poll_s))
            data = sock.recv(_CHUNK)
        except TimeoutError:
            if meanwhile is not None:
                meanwhile()
            return
        except OSError as error:
            raise LinkLost(
                f"connection lost: {_words(error)}", device=self.device, command=command, raw=self._buffer
            ) from error
        self._take(data, command)

    def _take(self, data: bytes, command: str) -> None:
        if not data:
            half = " in the middle of an answer" if self._buffer else ""
            raise LinkLost(
                f"device closed the connection{half}", device=self.device, command=command, raw=self._buffer
            )
        self._log("<", data)
        self._buffer += data

    def _open_socket(self, command: str) -> socket.socket:
        if self._socket is None:
            raise LinkLost("not connected", device=self.device, command=command)
        return self._socket

    def _log(self, direction: str, data: bytes) -> None:
        if self.wire is not None:
            self.wire.record(self.device, direction, data)


def _words(error: OSError | ValueError) -> str:
    """The text of the operating system for an error, without its number."""
    return getattr(error, "strerror", None) or str(error)
