"""A Fanuc on Modbus TCP: pymodbus writes and reads the frames, our link transmits them.

By itself, pymodbus reconnects, ignores frames of other transactions and waits for the rest of damaged ones. Here its
transport is replaced by `TcpLink`, with the one rule of all drivers: any answer that does not belong exactly to this
request closes the link. It must have the same transaction, unit, function and size, and for a write the same address.
Modbus TCP has no checksum. Therefore a target is read back before the robot is ordered to go, positions are read twice
(`arm.py`), and no single damaged write can start the robot's program (`registers.py`).

For a move, target, speed and a new number are written, then `go`. It has ended when the robot's program reports this
number as done. Unused addresses of a Fanuc read 0 and ignore writes without an error, which the reading back detects as
well.
"""

from __future__ import annotations

import re
import threading
import time
from collections.abc import Callable, Sequence
from contextlib import suppress

from pymodbus.client import ModbusTcpClient
from pymodbus.pdu import ExceptionResponse, ModbusPDU

from drivers.errors import Busy, CommandRefused, LinkError, LinkTimeout, NotReady, ProtocolError
from drivers.fanuc.controller import VERSION, WIDEST_DEG, FanucDeadlines, JointMove, MovePoller, other_version
from drivers.fanuc.registers import HmiProfile, IoProfile, MoveProgress, Profile
from drivers.interfaces import Identity, JointReading, RobotStatus
from drivers.link import TcpLink

_WRITE = 16
_UNIT = 1  # a Fanuc ignores it
_POLL_S = 0.02  # between two looks at a pending move
_VIEWS = 10  # a command goes through go, busy and done


class _Wire(ModbusTcpClient):
    """The client of pymodbus on our link.

    It sends one frame and accepts exactly the frame that answers it.
    """

    def __init__(self, link: TcpLink, deadlines: FanucDeadlines) -> None:
        super().__init__(link.address.host, port=link.address.port, retries=0)
        self.link = link
        self.deadlines = deadlines
        self.command = ""
        self._request = b""

    def connect(self) -> bool:
        return self.link.is_open

    def close(self) -> None:
        self.link.close()

    def send(self, request: bytes, addr: tuple[object, ...] | None = None) -> int:
        self._request = request
        self.link.send(request, command=self.command, send_s=self.deadlines.send_s)
        return len(request)

    def recv(self, size: int | None) -> bytes:
        forms = answers_to(self._request)

        def possible(received: bytes) -> bool:
            return any(
                received[: len(head)] == head[: len(received)] and len(received) < len(head) + rest
                for head, rest in forms
            )

        found = self.link.read_reply(
            re.compile(b"|".join(re.escape(head) + b".{%d}" % rest for head, rest in forms), re.DOTALL),
            command=self.command,
            deadline="reply_s",
            seconds=self.deadlines.reply_s,
            possible=possible,
        )
        return found[0]


def answers_to(request: bytes) -> list[tuple[bytes, int]]:
    """Return the possible answers to a request to read or write registers.

    Each is given by its beginning and the number of bytes that follow. It is the data, or a refusal: function + 128 and
    one byte.
    """
    transaction, unit, function = request[:4], request[6:7], request[7]
    refusal = transaction + b"\0\3" + unit + bytes([function | 0x80]), 1
    if function == _WRITE:
        return [(transaction + b"\0\6" + unit + request[7:12], 0), refusal]
    data = 2 * int.from_bytes(request[10:12], "big")
    head = transaction + (3 + data).to_bytes(2, "big") + unit + bytes([function, data])
    return [(head, data), refusal]


class ModbusRegisters:
    """Register access over one connection; one question at a time, from any thread."""

    def __init__(self, link: TcpLink, deadlines: FanucDeadlines) -> None:
        self.link = link
        self._wire = _Wire(link, deadlines)
        self._lock = threading.RLock()

    @property
    def deadlines(self) -> FanucDeadlines:
        return self._wire.deadlines

    @deadlines.setter
    def deadlines(self, deadlines: FanucDeadlines) -> None:
        self._wire.deadlines = deadlines

    def open(self) -> None:
        """Connect to the controller.

        Raises
        ------
        LinkError
            The connection failed.
        """
        with self._lock:
            self.link.open(connect_s=self.deadlines.connect_s)

    def read(self, table: str, address: int, count: int) -> list[int]:
        """Read registers of `holding` or `input`, addresses from 0.

        Raises
        ------
        LinkError
            The connection failed.
        CommandRefused
            The controller refused.
        """
        ask = self._wire.read_input_registers if table == "input" else self._wire.read_holding_registers
        answer = self._ask(f"read {table} {address}", lambda: ask(address, count=count, device_id=_UNIT))
        return list(answer.registers)

    def poke(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers.

        Raises
        ------
        LinkError
            The connection failed.
        CommandRefused
            The controller refused.
        """
        self._ask(
            f"write {address}", lambda: self._wire.write_registers(address, list(words), device_id=_UNIT)
        )

    def write(self, address: int, words: Sequence[int]) -> None:
        """Write holding registers and read them back.

        Raises
        ------
        LinkError
            The connection failed.
        CommandRefused
            The controller refused.
        NotReady
            The controller has other values than those written.
        """
        with self._lock:
            self.poke(address, words)
            kept = self.read("holding", address, len(words))
            for _ in range(_VIEWS):
                before = kept
                if kept == list(words):
                    return
                kept = self.read("holding", address, len(words))
                if kept == before:  # two equal answers: it is true, and no damaged answer
                    break
        raise NotReady(
            f"the controller keeps {kept}, not {list(words)}",
            device=self.link.device,
            command=f"write {address}",
            what_to_do="Check the register assignment of the controller (README of the robot side).",
        )

    def _ask(self, command: str, ask: Callable[[], ModbusPDU]) -> ModbusPDU:
        with self._lock, self.link.question(command):
            self._wire.command = command
            answer = ask()
        if isinstance(answer, ExceptionResponse):
            raise CommandRefused(
                f"Modbus exception {answer.exception_code}", device=self.link.device, command=command
            )
        return answer


class ModbusController:
    """The register dialect of a controller, in the profile that the address names."""

    def __init__(self, link: TcpLink, deadlines: FanucDeadlines) -> None:
        self.name = link.device
        self._clock = link.clock
        self._registers = ModbusRegisters(link, deadlines)
        hmi = link.address.options["modbus"] == "hmi"
        self._profile: Profile = HmiProfile() if hmi else IoProfile.of(link.address, self.name)
        self._beats = 0
        self._number = 0

    @property
    def deadlines(self) -> FanucDeadlines:
        return self._registers.deadlines

    @deadlines.setter
    def deadlines(self, deadlines: FanucDeadlines) -> None:
        self._registers.deadlines = deadlines

    @property
    def can_stop(self) -> bool:
        return True

    @property
    def dialect(self) -> str:
        return self._profile.dialect

    @property
    def weakness(self) -> str:
        return ""

    def open(self) -> None:
        """Connect to the controller.

        Raises
        ------
        LinkError
            The connection failed.
        """
        self._registers.open()

    def close(self) -> None:
        self._registers.link.close()

    def identity(self) -> Identity:
        """Return the identity; the registers report no serial number or type."""
        self.joints()
        return Identity("Fanuc", "", "", "", self.dialect)

    def prepare(self) -> None:
        """Check that the robot's program waits for a command, and avoid its last number.

        An error that stopped the program is raised as its class.

        Raises
        ------
        LinkError
            The connection failed, or the program has another version.
        Busy
            A move is under way.
        NotReady
            The program cannot move the robot.
        """
        seen = self._progress()
        if seen.trouble is not None:
            kind, text = seen.trouble
            raise kind(text, device=self.name, command="arm")
        if seen.version != VERSION:
            raise other_version(self._profile.program, seen.version, self.name)
        if not seen.ready:
            raise Busy("a move is under way", device=self.name, command="arm")
        self._number = seen.taken
        if self._next() == seen.done:
            self._number = seen.done

    def _next(self) -> int:
        return self._number % self._profile.last_number + 1

    def joints(self) -> JointReading:
        joints, raw = self._profile.joints(self._registers)
        if not all(abs(q) < WIDEST_DEG for q in joints):  # also refuses NaN
            self.close()
            raise ProtocolError(
                "no valid joint angles at this address", device=self.name, command="position", raw=raw
            )
        return JointReading(joints, self._profile.resolution_deg, raw)

    def move(self, move: JointMove) -> None:
        self._number = self._next()
        look = MovePoller(self._beat, self._clock)
        end = self._clock() + move.seconds
        self._beat()
        self._profile.command(self._registers, move.target, move.percent, self._number)
        while True:
            seen = self._progress()
            if seen.taken != self._number:
                self.halt()
                raise Busy("another client commands the robot", device=self.name, command="move_to")
            over = seen.done == self._number and not seen.busy
            refused = seen.refusal if over else seen.trouble
            if refused is not None:
                kind, text = refused
                raise kind(text, device=self.name, command="move_to")
            if over:
                return
            if move.stopped.is_set():  # the stop may have overtaken the move: say it again
                self.halt()
            if self._clock() >= end:
                self._give_up(move)
            look()
            time.sleep(_POLL_S)

    def _progress(self) -> MoveProgress:
        """Return the progress from two equal readings in a row, to exclude a damaged bit.

        Raises
        ------
        LinkError
            The connection failed, or the readings do not agree.
        """
        before = self._profile.progress(self._registers)
        for _ in range(_VIEWS):
            now = self._profile.progress(self._registers)
            if now == before:
                return now
            before = now
        self.close()
        raise ProtocolError("the state changes in every answer", device=self.name, command="move_to")

    def _give_up(self, move: JointMove) -> None:
        with suppress(LinkError):
            self.halt()
        self.close()
        raise LinkTimeout(
            f"no end of the move within move_s = {move.seconds:g} s", device=self.name, command="move_to"
        )

    def _beat(self) -> None:
        """Feed the watchdog of the robot's program."""
        self._beats += 1
        self._profile.beat(self._registers, self._beats)

    def halt(self) -> None:
        """Halt the robot.

        Raises
        ------
        LinkError
            The stop was not answered, also not on a new connection.
        """
        try:
            self._profile.halt(self._registers)
        except LinkError:  # a stop is worth a second try on a fresh connection
            self._registers.open()
            self._profile.halt(self._registers)

    def status(self) -> RobotStatus:
        return self._profile.status(self._registers)
