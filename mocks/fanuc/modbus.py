"""Simulated Modbus TCP servers of a Fanuc, with two register layouts.

`hmi` is the HMI option with the assignment of our README over the TP program CALHMI. An address that is not
assigned reads 0 and swallows writes without an error. Beyond four clients, the one silent for longest is
dropped.

`io` is the I/O option over the KAREL program CALIO. It has 16-bit words only, inputs of the robot from address
0, outputs from 100.

Frames are written and read by the simplest means. Written from the description of the options, not from the driver.
"""

from __future__ import annotations

import asyncio
import struct
import time
from collections.abc import Sequence
from typing import Protocol

from mocks.fanuc.controller import End, FanucController
from mocks.shared.sockets import drop

CLIENTS = 4  # $SNPX_PARAM.$NUM_MODBUS
BEAT_S = 2.0  # the watchdog of CALHMI and CALIO
_STOPPED, _RANGE, _SILENT, _UNFIT, _OTHER_TARGET = 1, 2, 3, 4, 5
VERSION = 2  # of CALHMI and CALIO
_STATUS = {End.ARRIVED: 0, End.STOPPED: _STOPPED, End.SILENT: _SILENT, End.UNFIT: _UNFIT}


class Image(Protocol):
    """Registers as a client sees them, addresses from 0."""

    def read(self, address: int) -> int: ...
    def write(self, address: int, word: int) -> None: ...


def little(value: bytes) -> list[int]:
    """Four bytes, low word first."""
    high, low = struct.unpack(">HH", value)
    return [low, high]


class _Program:
    """A program of the robot that waits for commands and runs one move at a time."""

    def __init__(self, controller: FanucController) -> None:
        self.controller = controller
        self.busy = False
        self.done = 0
        self.status = 0
        self._task: asyncio.Task[None] | None = None  # the loop itself keeps no strong reference

    def begin(self, target: Sequence[float], percent: int, number: int) -> None:
        self.busy = True
        self._task = asyncio.get_running_loop().create_task(self._run(target, percent, number))

    async def _run(self, target: Sequence[float], percent: int, number: int) -> None:
        self.controller.beat_s = BEAT_S
        end = await self.controller.move(target, percent)
        self.controller.beat_s = 0.0
        self.finish(_STATUS[end], number)

    def finish(self, status: int, number: int) -> None:
        self.status, self.done, self.busy = status, number, False


class HmiImage(_Program):
    """POS[0] joints at 0, PR[81] joints at 20, R[81..91] at 60, ALM[1] at 80, PRG[1] at 100. Go is number + 1000."""

    version = VERSION
    _NUMBER, _GO, _STOP = 61, 62, 66  # R[82], R[83], R[87]

    def __init__(self, controller: FanucController) -> None:
        super().__init__(controller)
        self._target = [0] * 19
        self._kept = {60: 0, 61: 0, 62: 0, 66: 0, 67: 0}

    def read(self, address: int) -> int:
        if address < 19:
            joints = (*self.controller.joints_deg(), 0.0, 0.0, 0.0)
            return 1 if address == 18 else little(struct.pack(">f", joints[address // 2]))[address % 2]
        if 20 <= address < 39:
            return self._target[address - 20]
        facility, number = self.controller.current_alarm()
        state = 2 if facility == 0 else 1
        if state == 1:  # the operator resets by starting the program again: it forgets its command
            self._kept[self._GO] = 0
        shown = {63: int(self.busy), 64: self.done, 65: self.status, 70: self.version}
        shown |= {80: facility, 81: number, 109: state}
        return (self._kept | shown).get(address, 0)

    def write(self, address: int, word: int) -> None:
        if 20 <= address < 39:
            self._target[address - 20] = word
        if address not in self._kept:
            return
        self._kept[address] = word
        self.controller.last_word = time.monotonic()
        if address == self._STOP and word and self.busy:
            self.controller.stop()
        if address == self._GO and word and not self.busy and self.controller.fit:
            self._go()

    def _go(self) -> None:
        pairs = (self._target[i : i + 2] for i in range(0, 12, 2))
        target = [struct.unpack(">f", struct.pack(">HH", high, low))[0] for low, high in pairs]
        number = self._kept[self._NUMBER]
        if self._kept[self._GO] != number + 1000:
            self.finish(_OTHER_TARGET, number)
        elif self._kept[self._STOP]:  # the skip condition holds already
            self.finish(self._kept[self._STOP], number)
        elif not self.controller.within_limits(target):
            self.controller.raise_alarm(15, 17)
        else:
            self.begin(target, self._kept[60], number)

    def finish(self, status: int, number: int) -> None:
        if status == _UNFIT:  # the program is paused in its motion instruction
            self.busy = False
            return
        super().finish(status, number)
        self._kept[self._GO] = 0


class IoImage(_Program):
    """Inputs at 0: command, speed, beat, six joints, sum. Outputs at 100: status, alarm, speed, six joints, version."""

    version = VERSION

    def __init__(self, controller: FanucController) -> None:
        super().__init__(controller)
        self._inputs = [0] * 16
        self._over = False

    def read(self, address: int) -> int:
        if address < 16:
            return self._inputs[address]
        if not 100 <= address < 116:
            return 0
        arm = self.controller.arm
        flags = (self.busy, self._over and not self.status, self._over and self.status, self.controller.fit)
        word = sum(1 << bit for bit, flag in enumerate((*flags, arm.emergency_stop, True)) if flag)
        joints = [round(q * 1e4) for q in self.controller.joints_deg()]
        shown = [word | self.done << 8, self.status, self._inputs[1]]
        words = [w for q in joints for w in little(struct.pack(">i", q))]
        return [*shown, *words, self.version][address - 100]

    def write(self, address: int, word: int) -> None:
        if address >= 16:
            return
        self._inputs[address] = word
        self.controller.last_word = time.monotonic()
        if address:
            return
        if word & 2 and self.busy:
            self.controller.stop()
        if word & 1 and not self.busy and word >> 8 != self.done:
            self._go(word >> 8)

    def _go(self, number: int) -> None:
        pairs = (self._inputs[i : i + 2] for i in range(3, 15, 2))
        target = [struct.unpack(">i", struct.pack(">HH", high, low))[0] * 1e-4 for low, high in pairs]
        self._over = False
        proof = 7919
        for word in (number, self._inputs[1], *self._inputs[3:15]):
            proof = (proof * 31 + word) % 65521
        if proof != self._inputs[15]:
            self.finish(_OTHER_TARGET, number)
        elif not self.controller.fit:
            self.finish(_UNFIT, number)
        elif not self.controller.within_limits(target):
            self.finish(_RANGE, number)
        else:
            self.begin(target, self._inputs[1], number)

    def finish(self, status: int, number: int) -> None:
        super().finish(status, number)
        self._over = True


class ModbusServer:
    """Function codes 1 to 6, 15 and 16 over one image; every unit is this one."""

    def __init__(self, image: Image) -> None:
        self.image = image
        self._clients: list[asyncio.StreamWriter] = []  # the one heard last stands last

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        self._clients.append(writer)
        if len(self._clients) > CLIENTS:
            await drop(self._clients.pop(0), reset=True)
        try:
            while True:
                head = await reader.readexactly(7)
                transaction, protocol, length, unit = struct.unpack(">HHHB", head)
                if protocol != 0 or not 2 <= length <= 254:
                    return
                body = await reader.readexactly(length - 1)
                answer = self._answer(body)
                self._clients.remove(writer)
                self._clients.append(writer)
                writer.write(struct.pack(">HHHB", transaction, 0, len(answer) + 1, unit) + answer)
                await writer.drain()
        finally:
            if writer in self._clients:
                self._clients.remove(writer)

    def _answer(self, body: bytes) -> bytes:
        function = body[0]
        if function not in (1, 2, 3, 4, 5, 6, 15, 16):
            return bytes([function | 0x80, 1])
        if len(body) < 5:
            return bytes([function | 0x80, 3])
        address, count = struct.unpack(">HH", body[1:5])
        if function in (1, 2):  # no signal is simulated: all off
            size = (count + 7) // 8
            return bytes([function, size]) + bytes(size)
        if function in (3, 4):
            if not 1 <= count <= 125:
                return bytes([function | 0x80, 3])
            words = [self.image.read(address + i) for i in range(count)]
            return bytes([function, 2 * count]) + struct.pack(f">{count}H", *words)
        if function == 6:
            self.image.write(address, count)
        if function == 16:
            if len(body) != 6 + 2 * count:
                return bytes([function | 0x80, 3])
            for i, word in enumerate(struct.unpack(f">{count}H", body[6:])):
                self.image.write(address + i, word)
        return body[:5]
