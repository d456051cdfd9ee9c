"""Simulated bridge of a FARO ION: MBP/1 lines on TCP over a TrackerDevice.

One controlling client; a second is told code 120. Long commands are acknowledged and run beside the reader,
so that ABORT and PING are answered meanwhile. A client silent for 30 s on the wall is dropped.
"""

from __future__ import annotations

import asyncio
import contextlib
import math
from collections.abc import Awaitable, Callable
from typing import Any

import numpy as np

from mocks import mbp
from mocks.clock import CellClock
from mocks.mbp import BadRequest, pairs, value
from mocks.tracker_device import TrackerDevice

SILENCE_S = 30.0
PRESSURE_HPA, HUMIDITY = 1013.2, 45.0
RATES_HZ = (1.0, 1000.0)


class FaroBridge:
    """The wire side. `odd` holds faults of single readings set by the back door, used up by one MEASURE."""

    def __init__(self, tracker: TrackerDevice, clock: CellClock) -> None:
        self.tracker = tracker
        self.clock = clock
        self.odd: dict[str, Any] = {}
        self._writer: asyncio.StreamWriter | None = None
        self._events = 0
        self._abort = asyncio.Event()
        self._job: asyncio.Task[None] | None = None
        self._changed = asyncio.Event()

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if self._writer is not None:
            number = (await reader.readline()).split(b" ")[0].decode("ascii", "replace")
            writer.write(mbp.line(f'{number} ERR code=120 text="in use" retry=1'))
            await writer.drain()
            return
        self._writer = writer
        try:
            while True:
                data = await asyncio.wait_for(reader.readline(), SILENCE_S)
                if not data.endswith(b"\n"):
                    return
                if not await self._answer(data):
                    return
        except (TimeoutError, ValueError):
            return  # silent for too long, or a line without end
        finally:
            self._writer = None
            if self._job is not None:
                self._job.cancel()
                with contextlib.suppress(asyncio.CancelledError):
                    await self._job
                self._job = None

    def event(self, name: str) -> None:
        """Tell the client something unasked; a measurement under way looks again."""
        self._changed.set()
        if self._writer is not None:
            self._events += 1
            self._writer.write(mbp.line(f"! {self._events} {name} {pairs(t=self.clock.now())}"))

    async def _send(self, text: str) -> None:
        if self._writer is not None:
            self._writer.write(mbp.line(text))
            await self._writer.drain()

    async def _answer(self, data: bytes) -> bool:
        number = 0
        try:
            parsed = mbp.request(data)
            if parsed is None:
                return True  # wrong sum: discarded, the client will time out
            number, command, fields = parsed
            long = {"INIT": self._init, "HOME": self._home, "POINT": self._point, "MEASURE": self._measure}
            if command in long:
                if self._job is not None and not self._job.done():
                    raise BadRequest(110, "busy", retry=True)
                self._abort.clear()
                self._job = asyncio.create_task(self._run(number, long[command], fields))
                return True
            reply = self._short(command, fields)
        except BadRequest as bad:
            await self._refuse(number, bad)
            return True
        await self._send(f"{number} OK {reply}".rstrip())
        return command != "BYE"

    async def _run(
        self, number: int, act: Callable[[dict[str, str]], Awaitable[str]], fields: dict[str, str]
    ) -> None:
        try:
            await self._send(f"{number} ACK eta=1.0")
            reply = await act(fields)
            await self._send(f"{number} OK {reply}".rstrip())
        except BadRequest as bad:
            await self._refuse(number, bad)
        except ConnectionError:
            return

    async def _refuse(self, number: int, bad: BadRequest) -> None:
        await self._send(f'{number} ERR code={bad.code} text="{bad.text}" retry={int(bad.retry)}')

    # -- short commands -----------------------------------------------------------------------------------

    def _short(self, command: str, fields: dict[str, str]) -> str:
        tracker = self.tracker
        if command == "HELLO":
            if fields.get("proto") != "1":
                raise BadRequest(103, "proto=1 only")
            names = pairs(
                proto=1, kind="TRACKER", vendor="FARO", model="ION", serial="X01000500000", fw="4.1"
            )
            return f"{names} {pairs(bridge='1.0', crc=1, units='mm,deg,C,hPa', sim=1)}"
        if command == "STATUS":
            busy = self._job is not None and not self._job.done()
            state = "BUSY" if busy and tracker.state == "READY" else tracker.state
            return f"state={state} " + (self._weather() if tracker.weather else "")
        if command in ("PING", "CLEAR", "BYE"):
            return ""
        if command == "ABORT":
            self._abort.set()
            self._changed.set()
            return ""
        if command == "WEATHER":
            if not tracker.weather:
                raise BadRequest(204, "no weather data")
            return self._weather() + " n=1.000270"
        if command == "MODE":
            if fields.get("distance") not in ("ADM", "IFM", "IFM_ADM"):
                raise BadRequest(103, "distance must be ADM, IFM or IFM_ADM")
            tracker.mode = fields["distance"]
            return ""
        if command == "TARGET":
            return ""
        if command == "LEVEL":
            return pairs(rx=0.0, ry=0.0)
        raise BadRequest(102, f"unknown command {command}")

    def _weather(self) -> str:
        return pairs(T=round(self.tracker.world.air_c(self.clock.now()), 2), P=PRESSURE_HPA, H=HUMIDITY)

    # -- long commands ------------------------------------------------------------------------------------

    async def _wait(self, seconds: float) -> None:
        """Simulated time passes. Raises BadRequest 110 on ABORT, 3xx when the beam breaks meanwhile."""
        end = self.clock.now() + seconds
        while (left := end - self.clock.now()) > 0:
            self._changed.clear()
            if self._abort.is_set():
                raise BadRequest(110, "aborted")
            await self.clock.wait(left, self._changed)
            if self.tracker.beam_broken:
                raise BadRequest(301, "beam broken", retry=True)

    async def _init(self, fields: dict[str, str]) -> str:
        if self.tracker.state == "WARMING":
            raise BadRequest(202, "warming up")
        await self._wait(20.0)
        if self.tracker.state == "OFF":
            self.tracker.state = "READY"
        return ""

    async def _home(self, fields: dict[str, str]) -> str:
        await self._wait(3.0)
        self.tracker.homed = True
        return ""

    async def _point(self, fields: dict[str, str]) -> str:
        if "az" in fields:
            az, el = math.radians(value(fields, "az")), math.radians(value(fields, "el"))
            ray = np.array([math.cos(el) * math.cos(az), math.cos(el) * math.sin(az), math.sin(el)])
            place = value(fields, "r") * ray
        else:
            place = np.array([value(fields, key) for key in "xyz"])
        await self._wait(1.0)
        if value(fields, "find", 0.0) == 0.0:
            return "found=0"
        self.tracker.point(place, value(fields, "radius", 30.0))
        return "found=1"

    async def _measure(self, fields: dict[str, str]) -> str:
        samples, rate = int(value(fields, "samples", 1.0)), value(fields, "rate", 100.0)
        if samples < 1 or not RATES_HZ[0] <= rate <= RATES_HZ[1]:
            raise BadRequest(103, "samples or rate out of range")
        tracker, arm = self.tracker, self.tracker.arm
        tracker.check_ready()
        asked = fields.get("target")
        name = tracker.choose(asked)
        before = arm.joints_deg()
        await self._wait(samples / rate)
        tracker.check_ready()
        if tracker.held != name:
            raise BadRequest(302, "target lost", retry=True)
        if arm.joints_deg() != before and name not in tracker.nests:
            raise BadRequest(303, "target moved during averaging", retry=True)
        point, scatter = tracker.average(name, samples)
        return self._reading(point, scatter, samples, asked if tracker.seated is None else None)

    def _reading(self, point: np.ndarray, scatter: np.ndarray, samples: int, name: str | None) -> str:
        odd, self.odd = self.odd, {}
        x, y, z = (float(v) for v in point)
        r = math.sqrt(x * x + y * y + z * z)
        az, el = math.degrees(math.atan2(y, x)), math.degrees(math.asin(z / r))
        answer: dict[str, object] = {"x": x, "y": y, "z": z}
        answer |= {key: float(v) for key, v in zip(("sx", "sy", "sz"), scatter, strict=True)}
        answer |= {"n": samples, "t": self.clock.now(), "age": 0.0, "az": az, "el": el, "r": r, "sr": 0.001}
        answer |= {"status": 0, "temp": round(self.tracker.world.air_c(self.clock.now()), 2)}
        answer |= {"P": PRESSURE_HPA, "H": HUMIDITY, "mode": self.tracker.mode, "face": 1}
        if name is not None:
            answer["target"] = name
        return pairs(**(answer | odd))
