"""RTDE server of a simulated UR controller (protocol version 2).

Written from the maker's guide. These properties are kept on purpose: recipes belong to one connection, pausing
twice is not an error, and an unknown package is answered by a text message.
"""

from __future__ import annotations

import asyncio
import struct
from collections.abc import Callable
from typing import Any

from mocks.shared.clock import CellClock
from mocks.ur.registers import Registers, Variable

LAYOUTS = {
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "INT32": "i",
    "UINT32": "I",
    "UINT64": "Q",
}
ZEROS = {  # other clients set these up before they do anything; nothing of them is simulated
    "DOUBLE": "actual_execution_time target_speed_fraction actual_momentum actual_main_voltage "
    "actual_robot_voltage actual_robot_current standard_analog_input0 standard_analog_input1 "
    "standard_analog_output0 standard_analog_output1 payload",
    "VECTOR3D": "actual_tool_accelerometer payload_cog",
    "VECTOR6D": "target_qdd target_current target_moment actual_current joint_control_output actual_TCP_pose "
    "actual_TCP_speed actual_TCP_force target_TCP_pose target_TCP_speed actual_joint_voltage payload_inertia",
    "VECTOR6INT32": "joint_mode",
    "UINT32": "robot_status_bits safety_status_bits",
    "UINT64": "actual_digital_input_bits actual_digital_output_bits",
}


def unsimulated() -> dict[str, Variable]:
    """Return variables that are always zero."""
    table: dict[str, Variable] = {}
    for kind, names in ZEROS.items():
        nothing = struct.unpack(">" + LAYOUTS[kind], bytes(struct.calcsize(">" + LAYOUTS[kind])))
        table |= {name: (kind, lambda nothing=nothing: nothing) for name in names.split()}
    return table


class RtdeClient:
    """One connection.

    `variables` is a function that returns the variables that can be requested now, by name.
    """

    def __init__(
        self,
        variables: Callable[[], dict[str, Variable]],
        registers: Registers,
        clock: CellClock,
        software: tuple[int, int, int, int],
        reader: asyncio.StreamReader,
        writer: asyncio.StreamWriter,
    ) -> None:
        self.variables = variables
        self.registers = registers
        self.clock = clock
        self.software = software
        self.reader = reader
        self.writer = writer
        self.version = 1
        self.period_s = 0.008
        self.recipes: dict[int, list[tuple[str, Callable[[], Any]]]] = {}
        self.inputs: dict[int, list[str]] = {}
        self.stream: asyncio.Task[None] | None = None

    async def serve(self) -> None:
        try:
            while True:
                size, kind = struct.unpack(">HB", await self.reader.readexactly(3))
                self._answer(chr(kind), await self.reader.readexactly(max(size - 3, 0)))
                await self.writer.drain()
        finally:
            self._stop()
            self.registers.release(self)

    def _send(self, kind: str, payload: bytes) -> None:
        self.writer.write(struct.pack(">HB", len(payload) + 3, ord(kind)) + payload)

    def _answer(self, kind: str, payload: bytes) -> None:
        if kind == "V":
            good = payload in (b"\0\1", b"\0\2")
            self.version = payload[1] if good else self.version
            self._send("V", bytes([good]))
        elif kind == "v":
            self._send("v", struct.pack(">4I", *self.software))
        elif kind == "O":
            self._set_up_outputs(payload)
        elif kind == "I":
            self._set_up_inputs(payload.decode("latin-1").split(","))
        elif kind in "SP":
            self._stop()
            self._send(kind, bytes([kind == "P" or bool(self.recipes)]))
            if kind == "S" and self.recipes:
                self.stream = asyncio.create_task(self._stream())
        elif kind == "U":
            self._input(payload)
        else:
            self._text(f"unknown package {kind!r}")

    def _set_up_outputs(self, payload: bytes) -> None:
        if self.version == 2:
            (frequency,) = struct.unpack(">d", payload[:8])
            payload = payload[8:]
            self.period_s = 1.0 / min(max(frequency, 1.0), 125.0)
        table = self.variables()
        found = [table.get(name) for name in payload.decode("latin-1").rstrip(",").split(",")]
        kinds = [entry[0] if entry else "NOT_FOUND" for entry in found]
        number = len(self.recipes) + 1 if all(found) else 0
        if number:
            self.recipes[number] = [(LAYOUTS[entry[0]], entry[1]) for entry in found if entry]
        head = bytes([number]) if self.version == 2 else b""
        self._send("O", head + ",".join(kinds).encode())

    def _set_up_inputs(self, names: list[str]) -> None:
        kinds = [self.registers.kind_of_input(name, self) for name in names]
        number = len(self.inputs) + 1 if set(kinds) == {"INT32"} else 0
        if number:
            self.inputs[number] = names
            self.registers.claim(names, self)
        self._send("I", bytes([number]) + ",".join(kinds).encode())

    def _input(self, payload: bytes) -> None:
        names = self.inputs.get(payload[0] if payload else 0)
        if names is None or len(payload) != 1 + 4 * len(names):
            self._text("input of no known recipe")
            return
        self.registers.receive(names, struct.unpack(f">{len(names)}i", payload[1:]))

    def _text(self, message: str) -> None:
        source = "RTDE"
        payload = bytes([len(message)]) + message.encode() + bytes([len(source)]) + source.encode() + b"\1"
        self._send("M", payload)

    async def _stream(self) -> None:
        number, fields = max(self.recipes.items())
        async for _, at_s in self.clock.ticks(self.period_s):
            data = bytearray([number])
            with self.clock.held(at_s):
                for layout, value in fields:
                    got = value()
                    data += struct.pack(">" + layout, *(got if isinstance(got, tuple) else (got,)))
            self._send("U", bytes(data))
            await self.writer.drain()

    def _stop(self) -> None:
        if self.stream is not None:
            self.stream.cancel()
            self.stream = None
