"""Simulated emScon server of a Leica AT901 (TCP 700 on the real one) over a LeicaDevice.

Packets are little-endian: i32 size, i32 type. There is one client; a second gets code 10011. There is one
command at a time; another gets status 1. A stationary measurement answers at once and sends its result packet
later. If the beam breaks meanwhile, it sends an error packet instead. Changes of settings are sent to the
client (unsolicited packets of type 8).
"""

from __future__ import annotations

import asyncio
import contextlib
from collections.abc import Callable
from typing import Any

import numpy as np

from mocks.leica.device import HUMIDITY, PRESSURE_HPA, LeicaDevice
from mocks.shared.mbp import BadRequest

REFLECTORS = ((1, "CCR-1.5in"), (2, "RRR-1.5in"), (7, "TBR-0.5in"))
# Where the tracker of `mocks.shared.tracker_device` speaks of an MBP/1 error, emScon has this number.
STATUS = {103: 3, 110: 1, 201: 39, 202: 10012, 204: 27, 301: 37, 302: 10004, 303: 10013, 310: 10004, 311: 3}
LOST, READY = 25, 27
CHANGES = {5: 6, 24: 17, 26: 12, 28: 18, 40: 7, 47: 8}  # command -> what changed
ANSWERED = (5, 24, 26, 28, 40, 43, 47)


def i32(*values: int) -> bytes:
    return b"".join(int(v).to_bytes(4, "little", signed=True) for v in values)


def f64(*values: float) -> bytes:
    return np.asarray(values, dtype="<f8").tobytes()


def packet(kind: int, body: bytes) -> bytes:
    """Return a whole packet with its header."""
    return i32(8 + len(body), kind) + body


def numbers(data: bytes) -> list[int]:
    """Return all of `data` as i32."""
    return [int(v) for v in np.frombuffer(data, dtype="<i4")]


class EmsconServer:
    """Wire side of the AT901.

    `odd` replaces fields of the next result packet: status, mode, x, y, z, sx, T. `settings` are the nine settings
    of the tracker, set by any program. A transformation that they apply scales points by `scale`.
    """

    def __init__(self, tracker: LeicaDevice) -> None:
        self.tracker = tracker
        self.odd: dict[str, Any] = {}
        self.time_ms = 2000
        self.reflector = 1
        self.settings = [2, 0, 0, 1, 1, 0, 0, 0, 0]
        self.scale = 1.0
        self.averaging = False
        self._writer: asyncio.StreamWriter | None = None
        self._job: asyncio.Task[None] | None = None
        self._changed = asyncio.Event()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._writer is not None:
            size = numbers(await reader.readexactly(8))[0]
            command = numbers(await reader.readexactly(size - 8))[0]
            writer.write(packet(0, i32(command, 10011)))
            await writer.drain()
            return
        self._writer = writer
        try:
            while True:
                size, kind = numbers(await reader.readexactly(8))
                if kind != 0 or not 12 <= size <= 1024:
                    return
                await self._command(await reader.readexactly(size - 8))
        finally:
            self._writer = None
            await self._end_job()

    async def _end_job(self) -> None:
        job, self._job = self._job, None
        if job is not None:
            job.cancel()
            with contextlib.suppress(asyncio.CancelledError):
                await job

    def event(self, name: str) -> None:
        """Send the event of the tracker after a change of the beam by the back door."""
        self._changed.set()
        codes = {"BEAM_BROKEN": LOST, "TARGET_LOST": LOST, "TARGET_FOUND": READY}
        if name in codes:
            self._send(8, i32(codes[name]))

    def _send(self, kind: int, body: bytes) -> None:
        if self._writer is not None:
            self._writer.write(packet(kind, body))

    def orders(self) -> dict[str, Any]:
        """Return the orders of the back door that only this tracker has."""
        return {"meddle": self.meddle, "positions": self.positions}

    def meddle(self, order: dict[str, Any]) -> None:
        """Change `settings`, `scale` and `reflector` as another program would.

        If the order has a `code`, the client receives it.
        """
        self.settings = order.get("settings", self.settings)
        self.scale = order.get("scale", self.scale)
        self.reflector = order.get("reflector", self.reflector)
        if "code" in order:
            self._send(8, i32(order["code"]))

    def positions(self, order: dict[str, Any]) -> None:
        """Send beam position and tilt unasked, as if another program had switched them on."""
        self._send(7, i32(0) + f64(1.0, 2.0, 3.0))
        self._send(6, i32(0, 0) + f64(0.0, 0.0, 20.0))

    # -- commands -----------------------------------------------------------------------------------------

    async def _command(self, body: bytes) -> None:
        command, arguments = numbers(body[:4])[0], body[4:]
        if command == 52:
            await self._end_job()
            self._send(0, i32(52, 0))
            return
        if self._job is not None and not self._job.done():
            self._send(0, i32(command, 1))
            return
        tables: dict[int, Callable[[], bytes]] = {
            1: self._system,
            2: self._ready,
            21: self._air,
            41: lambda: i32(self.reflector),
            48: lambda: i32(*self.settings),
        }
        if command in tables:
            self._send(0, i32(command, 0) + tables[command]())
        elif command == 42:
            for number, name in REFLECTORS:
                text = name.encode("utf-16-le").ljust(64, b"\0")
                self._send(0, i32(42, 0, len(REFLECTORS), number, 0) + f64(0.0) + text)
        elif command in (7, 49, 55):
            self._job = asyncio.create_task(self._run(command, arguments))
        elif command in ANSWERED:
            self._set(command, arguments)
        else:
            self._send(0, i32(command, 2))

    def _set(self, command: int, arguments: bytes) -> None:
        if command == 28:
            self.time_ms = numbers(arguments[:4])[0]
        if command == 40:
            self.reflector = numbers(arguments)[0]
        if command == 47:
            self.settings = numbers(arguments)
        known = self.reflector in dict(REFLECTORS) and self.time_ms > 0
        if command in CHANGES:
            self._send(8, i32(CHANGES[command]))
        self._send(0, i32(command, 0 if known else 3))

    def _system(self) -> bytes:
        weather = self.settings[0] if self.tracker.weather else 0
        return i32(0, 5, 3, 2, 3, 6, 0, weather, 0, 390123)

    def _ready(self) -> bytes:
        return i32({"OFF": 0, "WARMING": 1, "READY": 2}.get(self.tracker.state, 0))

    def _air(self) -> bytes:
        return f64(self.tracker.air_c(), PRESSURE_HPA, HUMIDITY)

    # -- what takes its time ------------------------------------------------------------------------------

    async def _wait(self, seconds: float) -> None:
        end = self.tracker.clock.now() + seconds
        while (left := end - self.tracker.clock.now()) > 0:
            self._changed.clear()
            await self.tracker.clock.wait(left, self._changed)
            if self.tracker.beam_broken:
                raise BadRequest(301, "beam broken")

    async def _run(self, command: int, arguments: bytes) -> None:
        acts = {7: self._initialise, 49: self._measure, 55: self._go}
        try:
            result = await acts[command](arguments)
            self._send(*result)
        except BadRequest as bad:
            kind = 1 if command == 49 else 0
            self._send(kind, i32(command, STATUS.get(bad.code, 36)))

    async def _initialise(self, arguments: bytes) -> tuple[int, bytes]:
        if self.tracker.state == "WARMING":
            raise BadRequest(202, "warming up")
        await self._wait(60.0)
        if self.tracker.state == "OFF":
            self.tracker.state = "READY"
        return 0, i32(7, 0)

    async def _go(self, arguments: bytes) -> tuple[int, bytes]:
        await self._wait(1.0)
        self.tracker.point(np.frombuffer(arguments[:24], dtype="<f8"), 30.0)
        return 0, i32(55, 0)

    async def _measure(self, arguments: bytes) -> tuple[int, bytes]:
        tracker = self.tracker
        self._send(0, i32(49, 0))
        tracker.check_ready()
        name = tracker.choose(None)
        before = tracker.arm.joints_deg()
        self.averaging = True
        try:
            await self._wait(self.time_ms / 1000.0)
        finally:
            self.averaging = False
        tracker.check_ready()
        if tracker.held != name:
            raise BadRequest(302, "target lost")
        if tracker.arm.joints_deg() != before and name not in tracker.nests:
            raise BadRequest(303, "target moved")
        point, scatter = tracker.average(name, max(2, self.time_ms // 10))
        point = point * (self.scale if self.settings[1] else 1.0)
        odd, self.odd = self.odd, {}
        x, y, z = (float(odd.get(axis, v)) for axis, v in zip("xyz", point, strict=True))
        sx, sy, sz = (float(v) for v in scatter)
        sx = float(odd.get("sx", sx))
        total = float(np.linalg.norm(scatter))
        air = (float(odd.get("T", tracker.air_c())), PRESSURE_HPA, HUMIDITY)
        head = i32(odd.get("status", 0), odd.get("mode", 0), 0)
        zero = (0.0, 0.0, 0.0)
        return 2, head + f64(x, y, z, sx, sy, sz, total, *zero, *zero, 0.0, *air)
