"""High-Speed Ethernet Server (HSES) of Yaskawa controllers, over UDP.

A datagram has a header of 32 bytes, little-endian, and up to 479 bytes of data:

| bytes | request | answer |
|---|---|---|
| 0-3, 4-5, 6-7 | `YERC`, size of the header (32), size of the data | the same |
| 8, 9, 10, 11 | 3, division (1: robot control), 0, number of the request | 3, 1, 1 (answer), the same number |
| 12-15, 16-23 | block number 0, `99999999` | block number, `99999999` |
| 24-31 | command, instance, attribute, service | service + 128, status, added status |

UDP loses, repeats, delays and reorders datagrams. Only an answer with the number of the pending request is taken; one
with another number is late or a repetition, and is skipped. Without an answer, a question is put again under a new
number, except the one that starts a job. A datagram of another form closes the connection. A new connection has a new
port, so that no datagram of the old one arrives there. HSES has no checksum: `arm.py` reads twice.

Sources: Yaskawa's instructions for the function (DX100 HW1480958, DX200 HW1481977, YRC1000 HW1483358), and for the
order of the fields Yaskawa-Global/HSES_Dissector and hsinkoyu/fs100. Not tried on a controller.
"""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass

from drivers.errors import (
    AcquisitionError,
    Busy,
    CommandRefused,
    LinkLost,
    LinkTimeout,
    MotionStopped,
    ProgramNotReady,
    ProtectiveStop,
    ProtocolError,
    WrongMode,
)
from drivers.link import CLOSED, Address, WireSink

JOINTS = 6
JOB = "TRUEPOSE1"  # the program of the robot side and its version
TARGET, SPEED, NUMBER, SUM, ECHO, TAKEN = 90, 96, 90, 91, 92, 93  # P, and else D variables of the job

_HEADER = struct.Struct("<4sHHBBBBI8s")
_GET_ALL, _SET_ALL, _GET, _SET = 0x01, 0x02, 0x0E, 0x10
_POSITION = struct.Struct("<5I8i")
_BUSY_DO = "Wait until the pendant has closed the job or file, then try again."
_REMOTE_DO = (
    "Turn the mode switch to REMOTE and allow command remote (IN/OUT, PSEUDO INPUT SIG), then confirm."
)


@dataclass(frozen=True, slots=True)
class YaskawaDeadlines:
    """Named waits in seconds.

    A move may take `move_factor` x its predicted time + `move_margin_s`.

    Attributes
    ----------
    reply_s
        For one datagram; a question is put `tries` times.
    start_s
        From the start of the job until it has taken the target.
    settle_s
        Time from the reported end of a move to two equal readings at the target, `gap_s` apart.
    """

    reply_s: float = 0.5
    tries: int = 3
    start_s: float = 2.0
    settle_s: float = 3.0
    gap_s: float = 0.05
    move_factor: float = 2.0
    move_margin_s: float = 10.0


@dataclass(frozen=True, slots=True)
class Question:
    """A request with its name for people, its data, and the number of bytes of its answer."""

    name: str
    command: int
    instance: int
    attribute: int
    service: int
    data: bytes = b""
    size: int = 0


STATUS = Question("read the status", 0x72, 1, 0, _GET_ALL, size=8)
ALARM = Question("read the alarm", 0x70, 1, 0, _GET_ALL, size=60)
PULSES = Question("read the position", 0x75, 1, 0, _GET_ALL, size=_POSITION.size)
IDENTITY = Question("read the system information", 0x89, 11, 0, _GET_ALL, size=48)
HOLD = Question("hold", 0x83, 1, 1, _SET, struct.pack("<I", 1))
RELEASE = Question("release the hold", 0x83, 1, 1, _SET, struct.pack("<I", 2))
ONE_CYCLE = Question("choose one cycle", 0x84, 2, 1, _SET, struct.pack("<I", 2))
SELECT = Question(f"select job {JOB}", 0x87, 1, 0, _SET_ALL, JOB.encode().ljust(32, b"\0") + bytes(4))
SELECTED = Question("read the selected job", 0x73, 1, 0, _GET_ALL, size=44)
START = Question(f"start job {JOB}", 0x86, 1, 1, _SET, struct.pack("<I", 1))


def reading_of(variable: int) -> Question:
    """Return the question for a D variable."""
    return Question(f"read D{variable:03d}", 0x7C, variable, 1, _GET, size=4)


def writing_of(variable: int, value: int) -> Question:
    """Return the request that writes a D variable."""
    return Question(f"write D{variable:03d}", 0x7C, variable, 1, _SET, struct.pack("<i", value))


def target_of(pulses: Sequence[int]) -> Question:
    """Return the request that writes the position variable of the job."""
    data = _POSITION.pack(0, 0, 0, 0, 0, *pulses, 0, 0)
    return Question(f"write P{TARGET:03d}", 0x7F, TARGET, 0, _SET_ALL, data)


def pulses_in(data: bytes, device: str) -> tuple[int, ...]:
    """Return the pulses of the six axes in a position.

    Raises
    ------
    ProtocolError
        It is no position in pulses, or has more axes.
    """
    kind, *_, seventh, eighth = fields = _POSITION.unpack(data)
    if kind != 0 or seventh or eighth:
        raise ProtocolError("no position of six axes in pulses", device=device, command="position", raw=data)
    return fields[5 : 5 + JOINTS]


def sum_of(number: int, speed: int, pulses: Sequence[int]) -> int:
    """Return the checksum that the job calculates as well: any one wrong value changes it."""
    weights = (3, 5, 7, 11, 13, 17, 19)
    return number + sum(w * v for w, v in zip(weights, (speed, *pulses), strict=True))


# Added status of a refusal -> class, text, remedy if the class has no better one.
_REFUSALS: dict[int, tuple[type[AcquisitionError], str, str | None]] = {
    0x2010: (Busy, "the robot is moving", None),
    0x2020: (MotionStopped, "held by the pendant", None),
    0x2030: (MotionStopped, "held by the playback panel", None),
    0x2040: (MotionStopped, "held by an external signal", None),
    0x2050: (MotionStopped, "held by a command", None),
    0x2060: (ProtectiveStop, "an alarm or error is shown", None),
    0x2070: (WrongMode, "servo power off", None),
    0x2080: (WrongMode, "mode switch not in play or remote", _REMOTE_DO),
    0x2090: (Busy, "another function uses the file", _BUSY_DO),
    0x2100: (WrongMode, "command remote is off", _REMOTE_DO),
    0x2110: (Busy, "the data cannot be accessed now", _BUSY_DO),
    0x2120: (Busy, "the data cannot be loaded now", _BUSY_DO),
    0x2130: (Busy, "a job is being edited", _BUSY_DO),
    0x3010: (WrongMode, "servo power off", None),
    0x3220: (WrongMode, "panel locked: a signal prohibits other modes and cycles", None),
    0x3230: (WrongMode, "panel locked: a signal prohibits the start", None),
    0x4040: (
        ProgramNotReady,
        f"no job {JOB}",
        f"Load {JOB}.JBI of this release (drivers/yaskawa/robot_side) into the controller, then confirm.",
    ),
    0x4060: (ProgramNotReady, "no job is selected", None),
    0xD8F1: (Busy, "the controller processes another command", None),
    0xD8FA: (Busy, "the controller processes another command", None),
    0xE444: (Busy, "the controller processes another command", None),
    0xFFF6: (Busy, "the controller has too many requests", None),
}


def refusal(status: int, added: int, device: str, question: Question, raw: bytes) -> AcquisitionError:
    """Return the error for an answer whose status is not 0."""
    where = {"device": device, "command": question.name, "raw": raw}
    if status != 0x1F:
        return ProtocolError(
            f"command {question.command:#x} refused with status {status:#04x}: unknown to this controller",
            what_to_do="Check that a DX100, DX200 or YRC1000 answers at this address, then connect again.",
            **where,
        )
    kind, text, do = _REFUSALS.get(added, (CommandRefused, f"refused with added status {added:#06x}", None))
    return kind(text, what_to_do=do, **where)


class HsesLink:
    """A client of a controller. Questions come from any thread, one at a time; `close` is always safe."""

    def __init__(
        self,
        address: Address,
        device: str,
        deadlines: YaskawaDeadlines,
        clock: Callable[[], float],
        wire: WireSink | None = None,
    ) -> None:
        self.address = address
        self.device = device
        self.deadlines = deadlines
        self._clock = clock
        self._wire = wire
        self._lock = threading.RLock()
        self._socket: socket.socket | None = None
        self._number = 0

    def open(self) -> None:
        """Take a new port of this computer. Nothing is sent.

        Raises
        ------
        LinkLost
            There is no way to the address.
        """
        self.close()
        place = (self.address.host, self.address.port)
        try:
            family, kind, protocol, _, found = socket.getaddrinfo(*place, type=socket.SOCK_DGRAM)[0]
            sock = socket.socket(family, kind, protocol)
        except OSError as error:
            raise self._lost(error, "connect") from error
        try:
            sock.connect(found)
        except OSError as error:
            sock.close()
            raise self._lost(error, "connect") from error
        self._socket = sock
        self._log("!", f"open {place[0]}:{place[1]}".encode())

    def close(self) -> None:
        """Close; never raises, from any thread."""
        sock, self._socket = self._socket, None
        if sock is not None:
            with suppress(OSError):
                sock.shutdown(socket.SHUT_RDWR)  # wakes a reader in another thread
            sock.close()
            self._log("!", b"close")

    def ask(self, question: Question) -> bytes:
        """Put a question, again if there is no answer, and return the data of its answer.

        Raises
        ------
        LinkError
            There is no answer, or it is damaged; the connection is closed.
        AcquisitionError
            The class that belongs to the refusal.
        """
        with self._lock:
            for _ in range(self.deadlines.tries):
                data = self.ask_once(question)
                if data is not None:
                    return data
            self.close()
        raise LinkTimeout(
            f"no answer within {self.deadlines.tries} x reply_s = {self.deadlines.reply_s:g} s",
            device=self.device,
            command=question.name,
        )

    def ask_once(self, question: Question) -> bytes | None:
        """Put a question once; None if there is no answer in time. Errors as in `ask`."""
        with self._lock:
            try:
                answer = self._exchange(question)
            except BaseException:
                self.close()
                raise
            if answer is None:
                return None
            status, added = answer[25], int.from_bytes(answer[28:30], "little") if answer[26] else 0
            if status:
                error = refusal(status, added, self.device, question, answer)
                if isinstance(error, ProtocolError):
                    self.close()
                raise error
            return answer[32:]

    def _exchange(self, question: Question) -> bytes | None:
        """Send a request and return the datagram that answers it, None if none comes in time."""
        sock = self._open_socket(question)
        self._number = (self._number + 1) % 256
        request = (
            _HEADER.pack(b"YERC", 32, len(question.data), 3, 1, 0, self._number, 0, b"99999999")
            + struct.pack(
                "<HHBBH", question.command, question.instance, question.attribute, question.service, 0
            )
            + question.data
        )
        self._log(">", request)
        end = self._clock() + self.deadlines.reply_s
        try:
            sock.send(request)
            while (left := end - self._clock()) > 0:
                sock.settimeout(left)
                answer = sock.recv(4096)
                if not answer and self._socket is None:
                    raise LinkLost("not connected any more", device=self.device, command=question.name)
                self._log("<", answer)
                if self._is_answer(question, answer):
                    return answer
        except TimeoutError:
            return None
        except OSError as error:
            raise self._lost(error, question.name) from error
        return None

    def _is_answer(self, question: Question, data: bytes) -> bool:
        """Check whether a datagram answers the pending request; False for an earlier one.

        Raises
        ------
        ProtocolError
            It cannot be an answer to a request of ours.
        """
        if len(data) >= 32:
            name, header, size, three, division, ack, number, _, nines = _HEADER.unpack_from(data)
            form = (name, header, size, three, division, ack, nines)
            if form == (b"YERC", 32, len(data) - 32, 3, 1, 1, b"99999999"):
                if number != self._number:
                    return False
                size = 0 if data[25] else question.size
                if data[24] == question.service | 0x80 and len(data) == 32 + size:
                    return True
        raise ProtocolError(
            "no answer of a High-Speed Ethernet Server to this question",
            device=self.device,
            command=question.name,
            raw=data,
        )

    def _open_socket(self, question: Question) -> socket.socket:
        if self._socket is None:
            raise LinkLost("not connected", device=self.device, command=question.name)
        return self._socket

    def _lost(self, error: OSError, command: str) -> LinkLost:
        where = f"{self.address.host}:{self.address.port}"
        if isinstance(error, ConnectionRefusedError):
            return LinkLost(
                f"{where} not reachable: the device answers, its port is closed",
                device=self.device,
                command=command,
                what_to_do=f"{CLOSED} The High-Speed Ethernet Server (10040) is enabled on the controller.",
            )
        return LinkLost(
            f"{where} not reachable: {error.strerror or error}", device=self.device, command=command
        )

    def _log(self, direction: str, data: bytes) -> None:
        if self._wire is not None:
            self._wire.record(self.device, direction, data)
