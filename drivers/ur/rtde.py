"""RTDE, the Real-Time Data Exchange of UR controllers (TCP 30004, protocol version 2).

Package: u16 size with its header, u8 type, payload, big-endian. Universal Robots, "Real-Time Data Exchange (RTDE)
guide". States only flow between START and PAUSE, and the driver requests both. A state that it uses was therefore sent
after its question, and nothing is unread when it asks the next one.

From software 3.9 on there are integer registers for external clients (24 to 47). Register 46 serves twice. As input it
is held by one client at a time, so that a second one is refused, and the watchdog of the running program waits for it.
As output it returns the number of the last program begun. The doubles from 24 on return the arguments of that program,
and it moves when input 47 holds its number (`drivers.ur.motion`).

**Stream.** While the arm moves, its joints are read back over a separate connection. A state is doubted if the speeds
of the joints do not lead to it from the one before. The reason is a damaged number, or states that were lost between
the two. Not tried on a controller yet.
"""

from __future__ import annotations

import logging
import math
import struct
import time
from collections.abc import Iterator
from contextlib import contextmanager

from drivers.errors import Busy, LinkTimeout, ProtocolError, naming
from drivers.interfaces import Sample
from drivers.link import TcpLink
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.software import Software
from drivers.ur.state import StateConfirmer, UrState, check_state

_LOG = logging.getLogger(__name__)

REGISTER, GO_REGISTER = 46, 47

FIRST_ARGUMENT, ARGUMENTS = 24, 10  # doubles in which a program shows its arguments

FREQUENCY_HZ = 125.0  # of a CB3; faster controllers accept it

_VERSION, _CONTROLLER, _OUTPUTS, _INPUTS = b"V"[0], b"v"[0], b"O"[0], b"I"[0]

_START, _PAUSE, _DATA, _TEXT = b"S"[0], b"P"[0], b"U"[0], b"M"[0]

_KINDS = (_VERSION, _CONTROLLER, _OUTPUTS, _INPUTS, _START, _PAUSE, _DATA, _TEXT)

_LONGEST = 4096

_MOST_TEXTS = 100  # of one connection

_ECHO = (
    (f"output_int_register_{REGISTER}", "INT32"),
    *((f"output_double_register_{i}", "DOUBLE") for i in range(FIRST_ARGUMENT, FIRST_ARGUMENT + ARGUMENTS)),
)

_INPUT_NAMES = f"input_int_register_{REGISTER},input_int_register_{GO_REGISTER}"

_FIELDS: tuple[tuple[str, str], ...] = (
    ("timestamp", "DOUBLE"),
    ("target_q", "VECTOR6D"),
    ("actual_q", "VECTOR6D"),
    ("target_qd", "VECTOR6D"),
    ("actual_qd", "VECTOR6D"),
    ("robot_mode", "INT32"),
    ("safety_mode", "INT32"),
    ("runtime_state", "UINT32"),
)

_VALUES = ">B25diiI"  # recipe, timestamp, four vectors, three modes

_REGISTERS = f"i{ARGUMENTS}d"

_BEAT_S = 0.2

_CLAIM_PAUSE_S = 0.05


def encode(kind: int, payload: bytes = b"") -> bytes:
    """Encode one package."""
    return struct.pack(">HB", 3 + len(payload), kind) + payload


def parse_data(payload: bytes, recipe: int, *, numbered: bool) -> UrState:
    """Parse a data package without its header.

    Raises
    ------
    ProtocolError
        The package has another recipe, or a value is out of range.
    """
    layout = _VALUES + _REGISTERS if numbered else _VALUES
    if len(payload) != struct.calcsize(layout) or payload[0] != recipe:
        raise ProtocolError("data of another recipe", raw=payload)
    _, t_s, *values = struct.unpack(layout, payload)
    target, actual, target_speed, actual_speed = (tuple(values[6 * i : 6 * i + 6]) for i in range(4))
    robot_mode, safety_mode, runtime_state, *echo = values[24:]
    state = UrState(
        t_s=t_s,
        target_rad=target,
        actual_rad=actual,
        target_rad_s=target_speed,
        actual_rad_s=actual_speed,
        robot_mode=robot_mode,
        safety_mode=safety_mode,
        runtime_state=runtime_state,
        echo=echo[0] if echo else None,
        arguments=tuple(echo[1:]),
        raw=payload,
    )
    check_state(state)
    return state


def parse_text(payload: bytes) -> str:
    """Parse a message of the controller as text: `source: message`.

    Raises
    ------
    ProtocolError
        The message has a wrong length.
    """
    texts, rest = [], payload
    for _ in range(2):
        if not rest or len(rest) < 1 + rest[0]:
            raise ProtocolError("text message of a wrong length", raw=payload)
        texts.append(rest[1 : 1 + rest[0]].decode("latin-1"))
        rest = rest[1 + rest[0] :]
    if len(rest) != 1 or rest[0] > 3:
        raise ProtocolError("text message of a wrong length", raw=payload)
    said = f"{texts[1]}: {texts[0]}"
    # A terminal would obey control characters.
    return "".join(each if each.isprintable() else "\ufffd" for each in said)


class Rtde:
    """An RTDE connection, used by one thread at a time; `close` is safe from any."""

    name = "rtde"

    def __init__(self, link: TcpLink, deadlines: UrDeadlines, rate_hz: float = FREQUENCY_HZ) -> None:
        self.device = link.device
        self._rate_hz = rate_hz
        self.deadlines = deadlines
        self._link, self._clock = link, link.clock
        self.software: Software = ()  # of the controller, once open
        self._recipe = 0
        self._echoed = False
        self._beat_recipe: int | None = None
        self._count = 0
        self._go = 0
        self._next_beat = -math.inf
        self._guarding = False
        self._told: set[str] = set()  # texts of the controller

    @property
    def confirms(self) -> bool:
        """Whether the controller has the registers in which a program shows its target. Once open.

        The program then waits until the target is confirmed.
        """
        return self._echoed

    @property
    def numbered(self) -> bool:
        """Whether programs can have a number and a watchdog.

        This needs the registers, with the input held by this client.
        """
        return self._echoed and self._beat_recipe is not None

    def open(self) -> None:
        """Connect, agree on version 2, set up the outputs.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self._beat_recipe, self._guarding = None, False
        self._told.clear()
        self._link.open(connect_s=self.deadlines.connect_s)
        with self._question("connect"):
            accepted = self._ask(_VERSION, struct.pack(">H", 2), "connect")
            if accepted != b"\x01":
                raise ProtocolError("controller speaks no RTDE version 2", raw=accepted)
            build = self._ask(_CONTROLLER, b"", "connect")
            if len(build) != 16:
                raise ProtocolError("not a controller version", raw=build)
            self.software = struct.unpack(">4I", build)
            self._echoed = self._set_up(*_ECHO)
            if not self._echoed:  # software before 3.9
                self._set_up()

    def _set_up(self, *more: tuple[str, str]) -> bool:
        """Set up the fields of a state, and `more`; False if the controller lacks one of `more`."""
        names = [name for name, _ in (*_FIELDS, *more)]
        wanted = [kind for _, kind in (*_FIELDS, *more)]
        reply = self._ask(_OUTPUTS, struct.pack(">d", self._rate_hz) + ",".join(names).encode(), "connect")
        types = reply[1:].decode("latin-1").split(",")
        if more and "NOT_FOUND" in types and types[: len(_FIELDS)] == wanted[: len(_FIELDS)]:
            return False
        if types != wanted or reply[0] == 0:
            raise ProtocolError("controller has other output fields than requested", raw=reply)
        self._recipe = reply[0]
        return True

    def claim(self) -> None:
        """Become the one client that controls.

        A lost connection may live on in the controller for a while, so the request is repeated for `reply_s`.

        Raises
        ------
        Busy
            Another client controls the robot.
        LinkError
            The connection failed.
        """
        end = self._clock() + self.deadlines.reply_s
        while self._echoed and self._beat_recipe is None:
            with self._question("arm"):
                reply = self._ask(_INPUTS, _INPUT_NAMES.encode(), "arm")
            kinds = reply[1:].split(b",")
            if kinds == [b"INT32"] * 2:
                self._beat_recipe = reply[0]
            elif b"IN_USE" not in kinds:
                raise ProtocolError(
                    "no input registers 46 and 47", device=self.device, command="arm", raw=reply
                )
            elif self._clock() > end:
                raise Busy(
                    "another program controls this robot", device=self.device, command="arm", raw=reply
                )
            else:
                time.sleep(_CLAIM_PAUSE_S)

    @contextmanager
    def watch(self, command: str, *, guarding: bool = False) -> Iterator[StateConfirmer]:
        """Yield states from now on, until the block ends; a fault in between closes the link.

        With `guarding`, the watchdog of a running program is kept alive.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._question(command):
            self._guarding, self._go, self._next_beat = guarding and self.numbered, 0, -math.inf
            self._switch(_START, command)
            yield StateConfirmer(lambda: self._state(command))
            self._guarding = False
            self._switch(_PAUSE, command)

    def release(self, number: int) -> None:
        """Let the program of this number move.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self._go, self._next_beat = number, -math.inf
        self._beat()

    def _beat(self) -> None:
        if not self._guarding or self._clock() < self._next_beat:
            return
        self._next_beat = self._clock() + _BEAT_S
        self._count = (self._count + 1) % 2**31
        data = encode(_DATA, struct.pack(">Bii", self._beat_recipe, self._count, self._go))
        self._link.send(data, command="beat", send_s=self.deadlines.send_s)

    def close(self) -> None:
        """Close; never raises."""
        self._link.close()

    @contextmanager
    def _question(self, command: str) -> Iterator[None]:
        with self._link.question(command), naming(self.device, command):
            yield

    def _switch(self, kind: int, command: str) -> None:
        reply = self._ask(kind, b"", command)
        if reply != b"\x01":
            raise ProtocolError("controller did not start or pause its data", raw=reply)

    def _ask(self, kind: int, payload: bytes, command: str) -> bytes:
        """Return the payload of the reply; data packages in between are checked and not used."""
        self._link.send(encode(kind, payload), command=command, send_s=self.deadlines.send_s)
        end = self._clock() + self.deadlines.reply_s
        while True:
            got, reply = self._package(command, end)
            if got == kind and reply:
                return reply
            if got != _DATA:
                raise ProtocolError("answer to another question, or not an answer", raw=reply)
            parse_data(reply, self._recipe, numbered=self._echoed)

    def _state(self, command: str) -> UrState:
        self._beat()
        kind, payload = self._package(command, self._clock() + self.deadlines.reply_s)
        if kind != _DATA:
            raise ProtocolError("answer that was not requested", raw=payload)
        return parse_data(payload, self._recipe, numbered=self._echoed)

    def _tell(self, text: str) -> None:
        """Log a message once: a controller may repeat it with every state."""
        if text not in self._told and len(self._told) < _MOST_TEXTS:
            self._told.add(text)
            _LOG.warning("%s says: %s", self.device, text)

    def _package(self, command: str, end: float) -> tuple[int, bytes]:
        """Return the next package that is not text.

        Raises
        ------
        LinkError
            The connection failed.
        """

        def part(count: int) -> bytes:
            return self._link.read_exactly(
                count,
                command=command,
                deadline="reply_s",
                seconds=end - self._clock(),
                meanwhile=self._beat,
            )

        while self._clock() < end:
            head = part(3)
            size, kind = struct.unpack(">HB", head)
            if kind not in _KINDS or not 3 <= size <= _LONGEST:
                raise ProtocolError("not an RTDE package", raw=head)
            if kind == _DATA and size != 3 + struct.calcsize(_VALUES + _REGISTERS * self._echoed):
                raise ProtocolError("data package of a wrong size", raw=head)
            payload = part(size - 3)
            if kind != _TEXT:
                return kind, payload
            self._tell(parse_text(payload))
        raise LinkTimeout(
            f"no answer within reply_s = {self.deadlines.reply_s:g} s", device=self.device, command=command
        )


@contextmanager
def joint_stream(rtde: Rtde) -> Iterator[Iterator[Sample]]:
    """Stream every state from now on until the block ends, which closes the connection.

    Raises
    ------
    LinkError
        The connection failed.
    """
    rtde.open()
    try:
        with rtde.watch("stream") as witness:
            yield _samples(witness)
    finally:
        rtde.close()


def _samples(witness: StateConfirmer) -> Iterator[Sample]:
    for state, led in witness.every():
        joints = tuple(math.degrees(q) for q in state.actual_rad)
        yield Sample(state.t_s, joints, doubt="" if led else "its speeds do not lead there")
