"""The TCP connection used by all drivers.

Any fault closes the connection, so that a late, split, merged, duplicated or truncated answer can never be taken as the
answer to a later question. In addition:

- Unread input before a question is an error.
- Only one question is outstanding.
- An answer ends at its exact terminator; half a line at the end of the stream is an error.
- Every wait has a named deadline.

**Addresses.** A device has one canonical address for every spelling of its URL. `tcp://localhost:5000`,
`TCP://127.0.0.1:05000/` and `tcp://[::1]:5000?background=5002` lead to one socket. The URL is parsed as by the
drivers, so that this address is the one to which they connect.
"""

from __future__ import annotations

import ipaddress
import json
import os
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

CLOSED = "Cable and power are in order: start the program that listens there, or correct the port."
"""What to do if a device answers that nothing listens at its port."""

_HOST = re.compile(r"[A-Za-z0-9_.:-]+")

_LOOPBACK = "loopback"


class WireSink(Protocol):
    """A receiver of every byte that is sent or received, for the record."""

    def record(self, device: str, direction: str, data: bytes) -> None: ...


class WireLog:
    """A wire log that writes JSON lines.

    They have t_s, device, dir (`>` to the device, `<` from it, `!` opened, closed) and data. `data` is latin-1 text, so
    that every byte survives the round trip. Time in seconds of the given clock.
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
    """Return the address of the same controller with the port of an option, by default `port`.

    Raises
    ------
    ConfigError
        The option is not a port.
    """
    text = address.options.get(option, str(port))
    if not text.isdecimal() or not 0 < int(text) < 65536:
        raise ConfigError(
            f"{option}={text!r} is not a port", device=device, what_to_do="Use a number from 1 to 65535."
        )
    return replace(address, port=int(text))


def parse_url(url: str, *, scheme: str = "tcp") -> Address:
    """Parse `tcp://host:port[?key=value]`, or the same with another scheme.

    Raises
    ------
    ConfigError
        The URL has another form; the message names the wrong part.
    """
    parts, do = urlsplit(url), f"Write the address as {scheme}://HOST:PORT."
    if parts.scheme != scheme:
        raise ConfigError(f"address {url!r} must begin with {scheme}://", what_to_do=do)
    try:
        host, port = parts.hostname, parts.port
    except ValueError as error:
        raise ConfigError(f"address {url!r}: {error}", what_to_do=do) from error
    if not host or not _HOST.fullmatch(host) or parts.path not in ("", "/") or parts.username:
        raise ConfigError(f"address {url!r} has a path, a user name or no host", what_to_do=do)
    if not port:
        raise ConfigError(f"address {url!r} has no port", what_to_do=do)
    return Address(host, port, dict(parse_qsl(parts.query)))


class TcpLink:
    """A TCP connection to a device.

    It is not shared between threads, except `close`, which is always safe.

    Attributes
    ----------
    clock
        Returns the time, s, for all deadlines of this connection.

    Parameters
    ----------
    enabled_at
        Returns where a person enables the port on the device, as a sentence. It is called when the port is closed.
    """

    poll_s = 0.1  # how often a waiting question looks at its `meanwhile`

    def __init__(
        self,
        address: Address,
        device: str,
        *,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
        enabled_at: Callable[[], str] = str,
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
        """Connect; an open connection is closed first.

        Raises
        ------
        LinkTimeout
            The device does not accept in time.
        LinkLost
            The device is not reachable, or its port is closed.
        """
        self.close()
        where = f"{self.address.host}:{self.address.port}"
        try:
            self._socket = socket.create_connection((self.address.host, self.address.port), timeout=connect_s)
        except TimeoutError as error:
            raise LinkTimeout(
                f"{where} did not accept within connect = {connect_s:g} s",
                device=self.device,
                command="connect",
                what_to_do=LinkError.advice,  # no reply at all, not even a refusal
            ) from error
        except ConnectionRefusedError as error:
            raise LinkLost(
                f"{where} not reachable: the device answers, its port is closed",
                device=self.device,
                command="connect",
                what_to_do=" ".join(filter(None, (CLOSED, self._enabled_at()))),
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
        """Enclose a question up to its parsed answer: any exception in the block closes the link.

        `unread_allowed` is for protocols whose device may send events by itself and whose answers have the number of
        their question.
        """
        try:
            if not unread_allowed:
                self._nothing_unread(command)
            yield
        except BaseException:
            self.close()
            raise

    def send(self, data: bytes, *, command: str, send_s: float) -> None:
        """Send all bytes.

        Raises
        ------
        LinkTimeout
            The device does not accept them in time.
        LinkLost
            The connection was lost.
        """
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
        """Read bytes up to and without the terminator; the rest stays for the next call.

        `meanwhile` is called every `poll_s` while waiting and may raise.

        Raises
        ------
        LinkTimeout
            No terminator came in time; the message names the deadline.
        LinkLost
            The connection was lost, or ended with half a line.
        ProtocolError
            The line is too long.
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
        """Read the next `count` bytes, for protocols that count; the rest stays.

        Raises
        ------
        LinkTimeout
            The bytes did not come in time.
        LinkLost
            The connection was lost.
        """
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
        """Read an answer without a terminator: all bytes received must match `complete` exactly.

        `possible` returns whether the bytes so far can still become an answer. Free text has no recognisable end: with
        `quiet_s` it ends when no more came for this time, unless it has the form `sure`. Errors are those of
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
                "bytes that were not requested", device=self.device, command=command, raw=self._buffer
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
    """Return the text of the operating system for an error, without its number."""
    return getattr(error, "strerror", None) or str(error)


def endpoints(url: str) -> frozenset[str]:
    """Return the `IP:port` of every address of the host in a URL, or that of a serial device.

    The address of a serial device is its real path. All loopback addresses, IPv4 or IPv6, count as one: `localhost` may
    be any of them. A name that cannot be resolved now is kept as it is.

    Raises
    ------
    ConfigError
        The URL is not an address.
    """
    if "://" not in url:
        return frozenset({os.path.realpath(url)})
    address = parse_url(url, scheme="udp" if urlsplit(url).scheme == "udp" else "tcp")
    try:
        found = socket.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
    except (OSError, UnicodeError):  # no such name; a name that is not valid for a name server
        return frozenset({f"{address.host.casefold().rstrip('.')}:{address.port}"})
    return frozenset(f"{_plain(str(place[0]))}:{address.port}" for *_, place in found)


def _plain(text: str) -> str:
    """Return an IP address without its zone; IPv4 within IPv6 as IPv4."""
    ip = ipaddress.ip_address(text.partition("%")[0])
    ip = getattr(ip, "ipv4_mapped", None) or ip
    # 0.0.0.0 and :: are answered by the computer that asks
    return _LOOPBACK if ip.is_loopback or ip.is_unspecified else str(ip)
