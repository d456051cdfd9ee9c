"""Simulated High-Speed Ethernet Server on UDP, for robot control.

Written from the maker's description of the function, not from the driver. A datagram is answered to where it came from,
with its number; nothing is remembered of a client. Requests that the server cannot read as a header are not answered.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from mocks.shared.sockets import Endpoint, Servers
from mocks.yaskawa.controller import AUTO, ONE_CYCLE, STEP, YaskawaController

GET_ALL, SET_ALL, GET_ONE, SET_ONE = 0x01, 0x02, 0x0E, 0x10
LAST = 0x8000_0000  # of the blocks of an answer
SOFTWARE, PARAMETERS = "YAS4.12.01A(US/EN)-00", "14.27"
VENDOR = 0x1F  # status of a refusal with an added status

Fields = tuple[int, int, int, int]


class HsesRefusal(Exception):
    """A request that is refused, with status and added status."""

    def __init__(self, status: int, added: int = 0) -> None:
        super().__init__(status, added)
        self.status, self.added = status, added


def vendor(added: int) -> HsesRefusal:
    """Return the usual refusal, with its reason."""
    return HsesRefusal(VENDOR, added)


class HsesServer:
    """Answers the datagrams of any client."""

    def __init__(self, controller: YaskawaController) -> None:
        self.controller = controller
        self.commands: dict[int, Callable[[Fields, bytes], bytes]] = {
            0x70: self._alarm,
            0x72: self._status,
            0x73: self._job,
            0x74: self._axes,
            0x75: self._position,
            0x76: self._nothing_behind,
            0x7B: self._number,
            0x7C: self._number,
            0x7F: self._position_variable,
            0x82: self._reset,
            0x83: self._hold_or_servo,
            0x84: self._cycle,
            0x86: self._start,
            0x87: self._select,
            0x89: self._system,
        }

    async def listen(self, servers: Servers, port: int) -> Endpoint:
        """Listen on a port, 0 for a free one.

        Raises
        ------
        OSError
            The port is taken.
        """
        found = await servers.listen_datagrams(self.answer, port)
        return Endpoint("yaskawa", "hses", found, scheme="udp")

    def answer(self, request: bytes) -> bytes | None:
        """Return the answer to a datagram; None for one that is not read."""
        if len(request) < 32 or request[:4] != b"YERC":
            return None
        number, service = request[11], request[29]
        try:
            data, status, added = self._carry_out(request), 0, 0
        except HsesRefusal as refusal:
            data, status, added = b"", refusal.status, refusal.added
        head = b"YERC" + struct.pack("<HHBBBB", 32, len(data), 3, 1, 1, number)
        head += struct.pack("<I", LAST) + b"99999999"
        head += struct.pack("<BBBBHH", service | 0x80, status, 1 if added else 0, 0, added, 0)
        return head + data

    def _carry_out(self, request: bytes) -> bytes:
        header, size = struct.unpack("<HH", request[4:8])
        if header != 32:
            raise vendor(0xE4A5)
        if size != len(request) - 32:
            raise vendor(0xE4A7)
        if request[8] != 3 or request[16:24] != b"99999999":
            raise vendor(0xE4A6)
        if request[9] != 1:
            raise vendor(0xE4A3)
        if request[10] != 0:
            raise vendor(0xE4A2)
        if request[12:16] != bytes(4):
            raise vendor(0xE4A1)
        fields: Fields = struct.unpack("<HHBB", request[24:30])
        if fields[0] not in self.commands:
            raise HsesRefusal(0x08)
        return self.commands[fields[0]](fields, request[32:])

    # -- reading ------------------------------------------------------------------------------------------

    def _status(self, fields: Fields, data: bytes) -> bytes:
        _asked(fields, instance=1, attribute=0, service=GET_ALL)
        on = self.controller
        modes = {STEP: 1, ONE_CYCLE: 2, AUTO: 4}[on.cycle]
        modes |= (on.running << 3) | (on.teaching << 5) | ((not on.teaching) << 6) | (on.remote << 7)
        flags = ("pendant" in on.holds) << 1 | ("external" in on.holds) << 2 | ("command" in on.holds) << 3
        flags |= (on.current_alarm() is not None) << 4 | on.error << 5 | on.servo_on << 6
        return struct.pack("<II", modes, flags)

    def _alarm(self, fields: Fields, data: bytes) -> bytes:
        if not 1 <= fields[1] <= 4:
            raise vendor(0xA001)
        _asked(fields, attribute=0, service=GET_ALL)
        number, name = (self.controller.current_alarm() if fields[1] == 1 else None) or (0, "")
        shown = (b"2026/11/28 12:00" if number else b"").ljust(16, b"\0")
        return struct.pack("<III", number, 0, 1 if number else 0) + shown + _padded(name, 32)

    def _job(self, fields: Fields, data: bytes) -> bytes:
        _asked(fields, instance=1, attribute=0, service=GET_ALL)
        name, line = self.controller.selected or ("", 0)
        return _padded(name, 32) + struct.pack("<III", line, 0, 10_000)

    def _axes(self, fields: Fields, data: bytes) -> bytes:
        _asked(fields, instance=1, attribute=0, service=GET_ALL)
        return b"".join(_padded(name, 4) for name in ("S", "L", "U", "R", "B", "T", "", ""))

    def _position(self, fields: Fields, data: bytes) -> bytes:
        _asked(fields, instance=1, attribute=0, service=GET_ALL)
        return struct.pack("<5I8i", 0, 0, 0, 0, 0, *self.controller.pulses(), 0, 0)

    def _nothing_behind(self, fields: Fields, data: bytes) -> bytes:
        _asked(fields, instance=1, attribute=0, service=GET_ALL)
        return bytes(32)

    def _system(self, fields: Fields, data: bytes) -> bytes:
        _asked(fields, instance=11, attribute=0, service=GET_ALL)
        return _padded(SOFTWARE, 24) + _padded(self.controller.model, 16) + _padded(PARAMETERS, 8)

    # -- variables ----------------------------------------------------------------------------------------

    def _number(self, fields: Fields, data: bytes) -> bytes:
        """I (two bytes) and D (four bytes) variables; no element but the first."""
        command, variable, attribute, service = fields
        letter, form = {0x7B: ("I", "<h"), 0x7C: ("D", "<i")}[command]
        if variable > 99:
            raise HsesRefusal(0x28)
        if attribute != 1:
            raise vendor(0xA002)
        name = f"{letter}{variable:03d}"
        if service == GET_ONE:
            return struct.pack(form, self.controller.variables.value(name))
        if service != SET_ONE:
            raise HsesRefusal(0x08)
        if len(data) != struct.calcsize(form):
            raise vendor(0xB003)
        self.controller.variables.put(name, *struct.unpack(form, data))
        return b""

    def _position_variable(self, fields: Fields, data: bytes) -> bytes:
        _, variable, attribute, service = fields
        positions = self.controller.variables.positions
        if variable > 127:
            raise HsesRefusal(0x28)
        if attribute != 0:
            raise vendor(0xA002)
        if service == GET_ALL:
            if variable not in positions:
                raise vendor(0xB001)
            return struct.pack("<5I8i", 0, 0, 0, 0, 0, *positions[variable])
        if service != SET_ALL:
            raise HsesRefusal(0x08)
        if len(data) != 52:
            raise vendor(0xB003)
        kind, _, tool, user, _, *pulses = struct.unpack("<5I8i", data)
        if kind != 0:
            raise vendor(0xB00C)
        if tool > 63:
            raise vendor(0xB00D)
        if user > 63:
            raise vendor(0xB00E)
        positions[variable] = tuple(pulses)
        return b""

    # -- control ------------------------------------------------------------------------------------------

    def _reset(self, fields: Fields, data: bytes) -> bytes:
        if fields[1] not in (1, 2):
            raise vendor(0xA001)
        _switched(fields, data, (1,))
        self._needs_remote()
        if fields[1] == 1:
            self.controller.alarm = None
        else:
            self.controller.error = False
        return b""

    def _hold_or_servo(self, fields: Fields, data: bytes) -> bytes:
        if fields[1] not in (1, 2, 3):
            raise vendor(0xA001)
        on = _switched(fields, data, (1, 2)) == 1
        self._needs_remote()
        if fields[1] == 1:
            self.controller.hold("command", on=on)
        elif fields[1] == 2:
            self.controller.arm.motors_on = on
            self.controller.arm.wake()
        return b""

    def _cycle(self, fields: Fields, data: bytes) -> bytes:
        if fields[1] != 2:
            raise vendor(0xA001)
        cycle = _switched(fields, data, (STEP, ONE_CYCLE, AUTO))
        self._needs_remote()
        self.controller.cycle = cycle
        return b""

    def _select(self, fields: Fields, data: bytes) -> bytes:
        _asked(fields, instance=1, attribute=0, service=SET_ALL)
        if len(data) != 36:
            raise vendor(0xB003)
        self._needs_remote()
        if self.controller.running:
            raise vendor(0x2010)
        if self.controller.file_busy:
            raise vendor(0x2130)
        name = data[:32].split(b"\0", 1)[0].decode("latin-1")
        (line,) = struct.unpack("<I", data[32:])
        if name not in self.controller.jobs:
            raise vendor(0x4040)
        if line >= len(self.controller.jobs[name].lines):
            raise vendor(0xB004)
        self.controller.select(name, line)
        return b""

    def _start(self, fields: Fields, data: bytes) -> bytes:
        if fields[1] != 1:
            raise vendor(0xA001)
        _switched(fields, data, (1,))
        on = self.controller
        self._needs_remote()
        reasons = (
            (on.running, 0x2010),
            ("pendant" in on.holds, 0x2020),
            ("external" in on.holds, 0x2040),
            ("command" in on.holds, 0x2050),
            (on.current_alarm() is not None or on.error, 0x2060),
            (not on.servo_on, 0x2070),
            (on.teaching, 0x2080),
            (on.selected is None, 0x4060),
        )
        for holds, added in reasons:
            if holds:
                raise vendor(added)
        on.start()
        return b""

    def _needs_remote(self) -> None:
        if not self.controller.remote:
            raise vendor(0x2100)


def _asked(fields: Fields, *, instance: int | None = None, attribute: int, service: int) -> None:
    """Refuse a request with another instance, attribute or service."""
    if instance is not None and fields[1] != instance:
        raise HsesRefusal(0x28)
    if fields[2] != attribute:
        raise vendor(0xA002)
    if fields[3] != service:
        raise HsesRefusal(0x08)


def _switched(fields: Fields, data: bytes, allowed: tuple[int, ...]) -> int:
    """Return the value of a request that switches something."""
    _asked(fields, attribute=1, service=SET_ONE)
    if len(data) != 4:
        raise vendor(0xB003)
    (value,) = struct.unpack("<I", data)
    if value not in allowed:
        raise vendor(0xB004)
    return value


def _padded(text: str, width: int) -> bytes:
    return text.encode("latin-1")[:width].ljust(width, b"\0")
