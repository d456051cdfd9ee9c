"""MBP/1, the Metrology Bridge Protocol: lines between a driver and a bridge.

The bridge uses a vendor's library.

    request   <seq> <CMD> [k=v ...]*crc          ack      <seq> ACK eta=<s>
    answer    <seq> OK [k=v ...]  |  <seq> ERR code=<n> text="..." retry=<0|1>
    event     ! <n> <EVENT> t=<s> [k=v ...]      sample   # <i> t=<s> ...

ASCII, one blank between fields, LF (CR before it ignored), 512 bytes at most. The checksum `*hhhh` is
CRC-16/CCITT-FALSE over all bytes before the asterisk; the greeting requests it (`crc=1`). Units mm, deg, s, degC, hPa,
%RH. Every answer names its question; an answer to another one is counted and never used. So is a sample outside a
requested stream (`listen`): the last client may have left one running, and a careless bridge answers all clients.
"""

from __future__ import annotations

import binascii
import itertools
import math
import re
import secrets
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from drivers.errors import (
    AcquisitionError,
    BeamBroken,
    Busy,
    CommandRefused,
    EmergencyStop,
    LinkLost,
    LinkTimeout,
    NoisyMeasurement,
    NotReady,
    OutOfRange,
    ProtocolError,
    TargetNotSeen,
    naming,
)
from drivers.link import Address, TcpLink, WireSink
from drivers.serial_link import SerialLink

LIMIT = 512
_FIELD = re.compile(r'([A-Za-z][A-Za-z0-9_]*)=(?:"([^"]*)"|([^\s"]+))')
_HEAD = re.compile(r"(?:(\d{1,10}) (OK|ERR|ACK)|! (\d{1,10}) ([A-Z_]+)|# (\d{1,10}))(?: (.*))?")
_SUM = re.compile(rb"\*([0-9A-Fa-f]{4})$")

_ERRORS: Mapping[int, type[AcquisitionError]] = {
    104: ProtocolError,
    110: NotReady,
    120: Busy,
    130: LinkTimeout,
    201: NotReady,
    202: NotReady,
    203: NotReady,
    204: NotReady,
    301: BeamBroken,
    302: TargetNotSeen,
    303: NoisyMeasurement,
    310: TargetNotSeen,
    311: OutOfRange,
    320: TargetNotSeen,
    321: TargetNotSeen,
    322: TargetNotSeen,
    401: NoisyMeasurement,
    402: NoisyMeasurement,
    403: NoisyMeasurement,
    404: NoisyMeasurement,
    502: NotReady,
    510: OutOfRange,
    511: OutOfRange,
    601: LinkLost,
    602: LinkLost,
    610: EmergencyStop,
}
_BODY = "Clear the view of the cameras on tool and base, then repeat the measurement."
_ADVICE: Mapping[int, str] = {
    320: _BODY,
    321: "Stick the targets of this body so that no turn of it looks the same, and teach it again.",
    322: _BODY,
    502: "Put a new battery into the instrument, then confirm.",
}


@dataclass(frozen=True, slots=True)
class Message:
    """A parsed line.

    `kind` is OK, ERR, ACK, EVENT or SAMPLE; `number` is that of the question, event or sample.
    """

    kind: str
    number: int
    fields: Mapping[str, str]
    event: str = ""
    raw: bytes = b""
    summed: bool = False  # it came with its checksum


def checksum(data: bytes) -> str:
    """Compute CRC-16/CCITT-FALSE as four hexadecimal digits ("123456789" gives 29B1)."""
    return f"{binascii.crc_hqx(data, 0xFFFF):04X}"


def encode(number: int, command: str, fields: Mapping[str, object]) -> bytes:
    """Encode a request line with checksum and LF.

    Numbers are written so that they read back to the same double.
    """
    text = " ".join([str(number), command, *(f"{key}={_text(value)}" for key, value in fields.items())])
    body = text.encode("ascii")
    return body + b"*" + checksum(body).encode() + b"\n"


def _text(value: object) -> str:
    return repr(value) if isinstance(value, float) else str(value)


def parse(line: bytes, *, checksum_needed: bool = False) -> Message:
    """Parse a line without its LF.

    Raises
    ------
    ProtocolError
        The line is not a message, or its checksum is wrong or missing.
    """
    line = line.removesuffix(b"\r")
    found = _SUM.search(line)
    body = line[: found.start()] if found else line
    if found and found[1].decode().upper() != checksum(body):
        raise ProtocolError("wrong checksum", raw=line)
    if not found and checksum_needed:
        raise ProtocolError("checksum missing", raw=line)
    try:
        text = body.decode("ascii")
    except UnicodeDecodeError as error:
        raise ProtocolError("not ASCII", raw=line) from error
    head = _HEAD.fullmatch(text)
    if not head or len(line) > LIMIT:
        raise ProtocolError("not a message", raw=line)
    fields = _fields(head[6] or "", line)
    if head[1]:
        return Message(head[2], int(head[1]), fields, raw=line, summed=bool(found))
    if head[3]:
        return Message("EVENT", int(head[3]), fields, head[4], raw=line, summed=bool(found))
    return Message("SAMPLE", int(head[5]), fields, raw=line, summed=bool(found))


def _fields(text: str, line: bytes) -> dict[str, str]:
    fields: dict[str, str] = {}
    at = 0
    while at < len(text):
        found = _FIELD.match(text, at)
        if not found or found[1] in fields or (found.end() < len(text) and text[found.end()] != " "):
            raise ProtocolError("damaged field", raw=line)
        fields[found[1]] = found[2] if found[3] is None else found[3]
        at = found.end() + 1
    if text.endswith(" "):
        raise ProtocolError("blank at the end of the line", raw=line)
    return fields


def number(message: Message, key: str, low: float = -math.inf, high: float = math.inf) -> float:
    """Return a finite number of an answer within low..high.

    Raises
    ------
    ProtocolError
        The field is missing, not a number, or out of range; the message names it.
    """
    text = message.fields.get(key)
    if text is None:
        raise ProtocolError(f"field {key} missing", raw=message.raw)
    try:
        value = float(text.replace("_", "?"))  # Python reads 1_5 as 15
    except ValueError as error:
        raise ProtocolError(f"{key}={text} is not a number", raw=message.raw) from error
    if not math.isfinite(value) or not low <= value <= high:
        raise ProtocolError(f"{key}={text} is not between {low:g} and {high:g}", raw=message.raw)
    return value


@dataclass(slots=True)
class MbpClient:
    """A client that asks one question at a time over a link, and keeps events in between."""

    address: Address
    device: str
    send_s: float = 1.0
    wire: WireSink | None = None
    clock: Callable[[], float] = time.monotonic
    strangers: int = 0  # answers to other questions, discarded
    samples: int = 0  # of another client's stream, discarded
    events: list[Message] = field(default_factory=list)
    # Number of events before the last question was acknowledged, None if it was not
    acked: int | None = None
    serial: SerialLink | None = None  # instead of TCP: sums are mandatory, and no number ever comes twice
    link: TcpLink | SerialLink = field(init=False)
    _numbers: itertools.count[int] = field(init=False)
    _checksum_needed: bool = False
    _send_lock: threading.Lock = field(default_factory=threading.Lock)

    def __post_init__(self) -> None:
        self.link = self.serial or TcpLink(self.address, self.device, wire=self.wire, clock=self.clock)
        # A serial line has no connections: an answer of the last conversation must not fit this one.
        self._numbers = itertools.count(1 + secrets.randbelow(2**30) if self.serial else 1)

    def open(self, *, connect_s: float, reply_s: float) -> Message:
        """Connect and greet.

        Raises
        ------
        LinkError
            The connection failed.
        ProtocolError
            The bridge has another protocol.
        Busy
            The bridge is in use.
        """
        if self.serial is None:
            self._numbers = itertools.count(1)
        self._checksum_needed = self.serial is not None
        self.events.clear()
        self.link.open(connect_s=connect_s)
        with naming(self.device, "HELLO"):
            try:
                hello = self.ask("HELLO", {"proto": 1, "client": "truepose", "crc": 1}, "reply_s", reply_s)
            except CommandRefused as error:
                self.link.close()
                update = "Update the bridge or this program: they speak different versions of MBP."
                raise ProtocolError(
                    f"greeting refused: {error.message}", raw=error.raw, what_to_do=update
                ) from error
            promised = hello.fields.get("crc") == "1"
            if promised and not hello.summed:
                self.link.close()
                raise ProtocolError("checksum missing", raw=hello.raw)
        self._checksum_needed = self.serial is not None or promised or hello.summed
        return hello

    @property
    def checksums(self) -> bool:
        """Whether every line of the bridge must have its checksum. Once open."""
        return self._checksum_needed

    def shout(self, command: str) -> None:
        """Send a command without waiting; its answer will be discarded by number. For ABORT only."""
        with self._send_lock:
            self.link.send(encode(next(self._numbers), command, {}), command=command, send_s=self.send_s)

    def ask(self, command: str, fields: Mapping[str, object], deadline: str, seconds: float) -> Message:
        """Ask one question and return the OK answer.

        Raises
        ------
        LinkError
            The connection failed.
        AcquisitionError
            The class of the bridge's error code.
        """
        with self.link.question(command, unread_allowed=True):
            with self._send_lock:
                asked = next(self._numbers)
                self.link.send(encode(asked, command, fields), command=command, send_s=self.send_s)
            self.acked = None
            end = self.clock() + seconds
            while True:
                message = self._next(command, deadline, seconds, end)
                if message.kind == "EVENT":
                    self.events.append(message)
                elif message.kind == "SAMPLE":
                    self.samples += 1
                elif message.number != asked:
                    self.strangers += 1
                elif message.kind == "ACK":
                    self.acked = len(self.events)
                else:
                    break
            if message.kind == "ERR":
                error = self._error(message, command)
                if isinstance(error, ProtocolError | LinkTimeout | LinkLost):
                    raise error
            else:
                return message
        raise error

    def listen(self, command: str, seconds: float) -> Message | None:
        """Return the next line of a stream, of any kind.

        The result is None if no line was complete within `seconds`.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self.link.question(command, unread_allowed=True):
            end = self.clock() + seconds
            try:
                return self._next(command, "quiet", seconds, end)
            except LinkTimeout:
                return None

    def _next(self, command: str, deadline: str, seconds: float, end: float) -> Message:
        line = b""
        while not line.strip():  # an empty line keeps a connection alive, and says nothing
            left = end - self.clock()
            if left <= 0:
                raise LinkTimeout(
                    f"no complete answer within {deadline} = {seconds:g} s",
                    device=self.device,
                    command=command,
                )
            line = self.link.read_until(b"\n", command=command, deadline=deadline, seconds=left, limit=LIMIT)
        with naming(self.device, command):
            return parse(line, checksum_needed=self._checksum_needed)

    def _error(self, message: Message, command: str) -> AcquisitionError:
        code = message.fields.get("code", "")
        kind = _ERRORS.get(int(code), CommandRefused) if code.isdecimal() else ProtocolError
        text = message.fields.get("text", "no text")
        advice = _ADVICE.get(int(code)) if code.isdecimal() else None
        said = f"bridge says {code}: {text}"
        return kind(said, device=self.device, command=command, raw=message.raw, what_to_do=advice)
