"""Serial connection with the methods and the rule of `drivers.link`: any fault closes it.

Any pyserial URL: `/dev/rfcomm0`, `COM5`, `socket://host:port`, `rfc2217://host:port`, `loop://`. 115200 8N1. A serial
line has no connections, so bytes of an earlier conversation may still be on their way after opening. Answers are
accepted only because every line has its checksum and the number of its question.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

from drivers.errors import ConfigError, LinkLost, LinkTimeout, ProtocolError
from drivers.link import WireSink

BAUD = 115200


class SerialLink:
    """A serial port.

    It is not shared between threads, except `close`, which is always safe.
    """

    poll_s = 0.05  # how long a read may hold up a `close` from another thread

    def __init__(
        self,
        url: str,
        device: str,
        *,
        baud: int = BAUD,
        wire: WireSink | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.url = url
        self.device = device
        self._baud = baud
        self._wire = wire
        self._clock = clock
        self._port: Any = None  # pyserial's URL handlers have no common typed base
        self._reading = threading.Lock()
        self._buffer = b""

    @property
    def is_open(self) -> bool:
        return self._port is not None

    def open(self, *, connect_s: float) -> None:
        """Open again and discard received bytes.

        Raises
        ------
        LinkLost
            The line cannot be opened.
        ConfigError
            There is no such kind of URL.
        """
        import serial  # of the extra `cell`

        self.close()
        options: dict[str, Any] = {"timeout": self.poll_s, "write_timeout": connect_s}
        try:
            if "://" not in self.url:
                options["exclusive"] = True  # two programs on one port read half the answers each
            port = serial.serial_for_url(self.url, self._baud, **options)
            self._port = port
            port.reset_input_buffer()
        except OSError as error:  # SerialException is one
            self.close()
            raise LinkLost(
                f"{self.url} cannot be opened: {error}", device=self.device, command="connect"
            ) from error
        except ValueError as error:
            raise ConfigError(
                f"address {self.url!r}: {error}",
                device=self.device,
                what_to_do="Use the name of a serial port, such as COM3 or /dev/ttyUSB0.",
            ) from error
        self._log("!", b"open " + self.url.encode())

    def close(self) -> None:
        """Close; never raises, may be called at any time and from any thread."""
        port, self._port = self._port, None
        self._buffer = b""
        if port is not None:
            socket = getattr(port, "_socket", None)
            with self._reading, suppress(OSError):
                port.close()
            if socket is not None:
                socket.close()  # pyserial's socket:// leaves it open when the peer has gone first
            self._log("!", b"close")

    @contextmanager
    def question(self, command: str, *, unread_allowed: bool = True) -> Iterator[None]:
        """Enclose one question and its answer: any exception in the block closes the link."""
        try:
            yield
        except BaseException:
            self.close()
            raise

    def send(self, data: bytes, *, command: str, send_s: float) -> None:
        """Send all bytes.

        Raises
        ------
        LinkTimeout
            The line does not accept them in time.
        LinkLost
            The line was lost.
        """
        import serial

        port = self._open_port(command)
        self._log(">", data)
        try:
            port.write_timeout = send_s
            port.write(data)
        except serial.SerialTimeoutException as error:
            raise LinkTimeout(
                f"request not taken within send = {send_s:g} s", device=self.device, command=command
            ) from error
        except OSError as error:
            raise LinkLost(f"line lost: {error}", device=self.device, command=command) from error

    def read_until(
        self, terminator: bytes, *, command: str, deadline: str, seconds: float, limit: int = 512
    ) -> bytes:
        """Read bytes up to and without the terminator; the rest stays.

        Errors are those of `TcpLink.read_until`.
        """
        end = self._clock() + seconds
        while terminator not in self._buffer:
            if len(self._buffer) > limit:
                raise ProtocolError(
                    f"no end of line within {limit} bytes",
                    device=self.device,
                    command=command,
                    raw=self._buffer,
                )
            if self._clock() >= end:
                raise LinkTimeout(
                    f"no complete answer within {deadline} = {seconds:.3g} s",
                    device=self.device,
                    command=command,
                    raw=self._buffer,
                )
            self._fill(command)
        line, self._buffer = self._buffer.split(terminator, 1)
        return line

    def _fill(self, command: str) -> None:
        try:
            with self._reading:
                port = self._open_port(command)
                data = port.read(max(1, port.in_waiting))
        except OSError as error:
            raise LinkLost(
                f"line lost: {error}", device=self.device, command=command, raw=self._buffer
            ) from error
        if data:
            self._log("<", data)
            self._buffer += data

    def _open_port(self, command: str) -> Any:
        port = self._port
        if port is None:
            raise LinkLost("not connected", device=self.device, command=command)
        return port

    def _log(self, direction: str, data: bytes) -> None:
        if self._wire is not None:
            self._wire.record(self.device, direction, data)
