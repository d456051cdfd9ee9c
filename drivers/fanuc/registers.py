"""The two register layouts of a Fanuc on Modbus TCP, and the form of a move in each.

`hmi` (option R553, from V8.30) has registers and position registers, as `robot_side/README.md` assigns them in
`$SNPX_ASG`, with 32-bit values, low word first. `io` (R-30iA) has 16-bit group signals only, each joint as two words of
1e-4 deg, low first. Their place is not published, so both base addresses are in the address:
`?modbus=io&inputs=0&outputs=100&table=holding`. Addresses here count from 0.

The robot-side program echoes the number of a command when it is done, so that an older "done" is not accepted. It shows
its version, and no state that a single damaged write can produce starts it. In `hmi` the go word is the number plus
1000, written after all else was read back; in `io` a sum over number, speed and joints must agree.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from pymodbus.client.mixin import ModbusClientMixin

from drivers.errors import AcquisitionError, ConfigError, EnableLost, WrongMode
from drivers.fanuc.controller import JOINTS, STOPPED_BY_CLIENT, UNFIT, alarm, ended
from drivers.interfaces import RobotStatus
from drivers.link import Address

_FLOAT, _INT = ModbusClientMixin.DATATYPE.FLOAT32, ModbusClientMixin.DATATYPE.INT32

Refusal = tuple[type[AcquisitionError], str]


class FanucRegisters(Protocol):
    """Register access; methods raise LinkError.

    `write` reads back what it wrote; `poke` is for words that the robot's program may change at once.
    """

    def read(self, table: str, address: int, count: int) -> list[int]: ...
    def write(self, address: int, words: Sequence[int]) -> None: ...
    def poke(self, address: int, words: Sequence[int]) -> None: ...


@dataclass(frozen=True, slots=True)
class MoveProgress:
    """The progress of moves as the robot's program reports it.

    Attributes
    ----------
    version
        Version of the program, 0 while it has not run.
    taken
        Number of the last command that it started or was given.
    done
        Number of the last command that it finished.
    refusal
        Reason why that one did not end at its target.
    trouble
        Reason why no motion continues.
    ready
        Whether the program waits for a command.
    """

    version: int
    taken: int
    done: int
    busy: bool
    ready: bool
    refusal: Refusal | None
    trouble: Refusal | None


class Profile(Protocol):
    """A layout of the registers."""

    dialect: str
    program: str
    resolution_deg: float
    last_number: int

    def joints(self, registers: FanucRegisters) -> tuple[tuple[float, ...], bytes]: ...
    def command(
        self, registers: FanucRegisters, target: Sequence[float], percent: int, number: int
    ) -> None: ...
    def progress(self, registers: FanucRegisters) -> MoveProgress: ...
    def halt(self, registers: FanucRegisters) -> None: ...
    def beat(self, registers: FanucRegisters, count: int) -> None: ...
    def status(self, registers: FanucRegisters) -> RobotStatus: ...


def _pack(values: Sequence[float], kind: ModbusClientMixin.DATATYPE) -> list[int]:
    return [w for v in values for w in ModbusClientMixin.convert_to_registers(v, kind, word_order="little")]


def _unpack(words: Sequence[int], kind: ModbusClientMixin.DATATYPE) -> list[float]:
    pairs = (words[i : i + 2] for i in range(0, len(words), 2))
    values = (ModbusClientMixin.convert_from_registers(pair, kind, word_order="little") for pair in pairs)
    return [float(value) for value in values if isinstance(value, int | float)]


def sum_of(words: Sequence[int]) -> int:
    """Compute the checksum of a command, below 65521 and different from that of all-zero words."""
    total = 7919
    for word in words:
        total = (31 * total + word) % 65521
    return total


def _raw(words: Sequence[int]) -> bytes:
    return b"".join(word.to_bytes(2, "big") for word in words)


class HmiProfile:
    """The layout `hmi`.

    R[81] speed %, R[82] number, R[83] go, R[84] busy, R[85] done number, R[86] status, R[87] stop, R[88] beat, R[91]
    version.
    """

    dialect = "modbus-hmi"
    program = "CALHMI"
    resolution_deg = 2e-5  # of a 32-bit float at 180 deg
    last_number = 32767
    _HERE, _TARGET, _R81, _R83, _R87, _R88 = 0, 20, 60, 62, 66, 67
    _VIEW, _ALARM, _STATE = (60, 58), 20, 49  # one reading of R[81..88], ALM[1] and PRG[1]; offsets in it
    _ABORTED, _PAUSED = 0, 1
    # Offset of R[91]; go is beyond any speed, so that neither is taken for the other
    _VERSION_AT, _GO_FROM = (
        10,
        1000,
    )

    def joints(self, registers: FanucRegisters) -> tuple[tuple[float, ...], bytes]:
        words = registers.read("holding", self._HERE, 19)
        valid = words[18] == 1  # VALIDJ; an address that is not assigned reads 0
        return tuple(_unpack(words[: 2 * JOINTS], _FLOAT)) if valid else (math.nan,) * JOINTS, _raw(words)

    def command(self, registers: FanucRegisters, target: Sequence[float], percent: int, number: int) -> None:
        registers.write(self._TARGET, [*_pack((*target, 0.0, 0.0, 0.0), _FLOAT), 1])
        registers.write(self._R87, [0])
        registers.write(self._R81, [percent, number])
        registers.poke(self._R83, [self._GO_FROM + number])

    def progress(self, registers: FanucRegisters) -> MoveProgress:
        words = registers.read("holding", *self._VIEW)
        _, number, go, busy, done, status, _, _ = words[:8]
        state, facility, alarm_number = words[self._STATE], words[self._ALARM], words[self._ALARM + 1]
        trouble: Refusal | None = None
        if state == self._PAUSED:
            trouble = alarm(facility, alarm_number)
        elif state == self._ABORTED:
            trouble = ended(UNFIT)[0], "the program CALHMI does not run"
        return MoveProgress(
            version=words[self._VERSION_AT],
            taken=number,
            done=done,
            busy=bool(busy or go),
            ready=state not in (self._PAUSED, self._ABORTED) and not busy and not go,
            refusal=ended(status) if status else None,
            trouble=trouble,
        )

    def halt(self, registers: FanucRegisters) -> None:
        registers.poke(self._R87, [STOPPED_BY_CLIENT])

    def beat(self, registers: FanucRegisters, count: int) -> None:
        registers.poke(self._R88, [count % 32768])

    def status(self, registers: FanucRegisters) -> RobotStatus:
        """Return the status.

        Mode and motors are not in these registers; an emergency stop shows as its alarm.
        """
        words = registers.read("holding", *self._VIEW)
        facility, number = words[self._ALARM : self._ALARM + 2]
        pressed = words[self._STATE] == self._PAUSED and (facility, number) in ((11, 1), (11, 2), (11, 7))
        error = facility * 1000 + number or None
        raw = _raw((*words[:8], facility, number, words[self._STATE]))
        return RobotStatus("unknown", None, pressed, bool(words[3]), error, raw)


class IoProfile:
    """The layout `io`.

    Inputs of the robot: command, speed %, beat, joints, sum. Outputs: status, alarm, speed %, joints, version.

    Command word: bit 0 go, bit 1 stop, bits 8-15 number. Status word: bit 0 busy, 1 done, 2 error, 3 ready (servo on,
    pendant off), 4 emergency stop, 5 program running, bits 8-15 number. Alarm word: with bit 2 the status of a move.
    """

    dialect = "modbus-io"
    program = "CALIO"
    resolution_deg = 1e-4
    last_number = 255
    _GO, _STOP = 1, 2
    _BUSY, _DONE, _ERROR, _FIT, _ESTOP, _RUNS = (1 << bit for bit in range(6))
    _JOINTS_AT, _VERSION_AT = 3, 3 + 2 * JOINTS
    _WORDS = _VERSION_AT + 1

    def __init__(self, inputs: int, outputs: int, table: str) -> None:
        self._inputs = inputs
        self._outputs = outputs
        self._table = table
        self._number = 0

    @classmethod
    def of(cls, address: Address, name: str) -> IoProfile:
        """Return the profile that the options of an address specify.

        Raises
        ------
        ConfigError
            An option is not valid.
        """

        def base(key: str, usual: str) -> int:
            text = address.options.get(key, usual)
            if not text.isdecimal() or int(text) > 65000:
                raise ConfigError(
                    f"{key}={text!r} is not a register address",
                    device=name,
                    what_to_do="Use the number of a register.",
                )
            return int(text)

        table = address.options.get("table", "holding")
        if table not in ("holding", "input"):
            raise ConfigError(
                f"table={table!r} is neither holding nor input",
                device=name,
                what_to_do="Use table=holding or table=input.",
            )
        return cls(base("inputs", "0"), base("outputs", "100"), table)

    def _view(self, registers: FanucRegisters) -> list[int]:
        return registers.read(self._table, self._outputs, self._WORDS)

    def joints(self, registers: FanucRegisters) -> tuple[tuple[float, ...], bytes]:
        words = self._view(registers)
        joints = _unpack(words[self._JOINTS_AT : self._VERSION_AT], _INT)
        return tuple(q * 1e-4 for q in joints), _raw(words)

    def command(self, registers: FanucRegisters, target: Sequence[float], percent: int, number: int) -> None:
        self._number = number
        registers.write(self._inputs, [number << 8])
        registers.write(self._inputs + 1, [percent])
        joints = _pack([round(q * 1e4) for q in target], _INT)
        proof = sum_of((number, percent, *joints))
        registers.write(self._inputs + self._JOINTS_AT, [*joints, proof])
        registers.write(self._inputs, [number << 8 | self._GO])

    def progress(self, registers: FanucRegisters) -> MoveProgress:
        (asked,) = registers.read("holding", self._inputs, 1)
        word, number, *_, version = self._view(registers)
        runs, fit = bool(word & self._RUNS), bool(word & self._FIT)
        trouble: Refusal | None = None
        if word & self._ESTOP:
            trouble = alarm(11, 1)
        elif not runs:
            trouble = ended(UNFIT)[0], "the program CALIO does not run"
        elif not fit:
            trouble = EnableLost if number == UNFIT else WrongMode, "servo power off, or pendant enabled"
        return MoveProgress(
            version=version,
            taken=asked >> 8,
            done=word >> 8 if word & (self._DONE | self._ERROR) else 0,
            busy=bool(word & self._BUSY),
            ready=runs and not word & self._BUSY,
            refusal=(trouble or ended(number)) if word & self._ERROR else None,
            trouble=trouble,
        )

    def halt(self, registers: FanucRegisters) -> None:
        registers.poke(self._inputs, [self._number << 8 | self._STOP])

    def beat(self, registers: FanucRegisters, count: int) -> None:
        registers.poke(self._inputs + 2, [count % 32768])

    def status(self, registers: FanucRegisters) -> RobotStatus:
        word, number, *_ = self._view(registers)
        fit, pressed = bool(word & self._FIT), bool(word & self._ESTOP)
        known = bool(word & self._RUNS)  # without its program the outputs say nothing
        return RobotStatus(
            "auto" if fit else "unknown",
            fit if known else None,
            pressed,
            bool(word & self._BUSY),
            number or None,
            _raw((word, number)),
        )
