"""Simulated bridge of a FARO ION: MBP/1 lines on TCP over a TrackerDevice."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mocks.shared.clock import CellClock
from mocks.shared.mbp import BadRequest, pairs, place, value
from mocks.shared.mbp_bridge import Fields, MbpBridge
from mocks.shared.tracker_device import TrackerDevice

PRESSURE_HPA, HUMIDITY = 1013.2, 45.0
RATES_HZ = (1.0, 1000.0)


class FaroBridge:
    """Wire side of the FARO tracker.

    `odd` holds faults of single readings that the back door sets; one MEASURE uses them up.
    """

    def __init__(self, tracker: TrackerDevice, clock: CellClock) -> None:
        self.tracker = tracker
        self.odd: dict[str, Any] = {}
        self.bridge = MbpBridge(
            clock,
            pairs(proto=1, kind="TRACKER", vendor="FARO", model="ION", serial="X01000500000", fw="4.1")
            + " "
            + pairs(bridge="1.0", crc=1, units="mm,deg,C,hPa", sim=1),
            self._state,
            {"WEATHER": self._weather, "MODE": self._mode, "TARGET": lambda _: "", "LEVEL": self._level},
            {"INIT": self._init, "HOME": self._home, "POINT": self._point, "MEASURE": self._measure},
            tracker.sample,
        )

    def event(self, name: str) -> None:
        self.bridge.event(name)

    def reboot(self) -> None:
        self.tracker.state = "OFF"
        self.bridge.reboot()

    # -- short commands -----------------------------------------------------------------------------------

    def _air_c(self) -> float:
        return round(self.tracker.world.air_c(self.tracker.clock.now()), 2)

    def _air(self) -> str:
        return pairs(T=self._air_c(), P=PRESSURE_HPA, H=HUMIDITY)

    def _state(self) -> str:
        state = "BUSY" if self.bridge.busy and self.tracker.state == "READY" else self.tracker.state
        return f"state={state} " + (
            self._air() if self.tracker.weather and self.tracker.status_has_weather else ""
        )

    def _weather(self, fields: Fields) -> str:
        if not self.tracker.weather:
            raise BadRequest(204, "no weather data")
        return self._air() + " n=1.000270"

    def _mode(self, fields: Fields) -> str:
        if fields.get("distance") not in ("ADM", "IFM", "IFM_ADM"):
            raise BadRequest(103, "distance must be ADM, IFM or IFM_ADM")
        self.tracker.mode = fields["distance"]
        return ""

    def _level(self, fields: Fields) -> str:
        return pairs(rx=0.0, ry=0.0)

    # -- long commands ------------------------------------------------------------------------------------

    def _look(self) -> None:
        if self.tracker.beam_broken:
            raise BadRequest(301, "beam broken", retry=True)

    async def _init(self, fields: Fields) -> str:
        if self.tracker.state == "WARMING":
            raise BadRequest(202, "warming up")
        await self.bridge.wait(20.0, self._look)
        if self.tracker.state == "OFF":
            self.tracker.state = "READY"
        return ""

    async def _home(self, fields: Fields) -> str:
        await self.bridge.wait(3.0, self._look)
        self.tracker.homed = True
        return ""

    async def _point(self, fields: Fields) -> str:
        aim = np.array(place(fields))
        await self.bridge.wait(1.0, self._look)
        if value(fields, "find", 0.0) == 0.0:
            return "found=0"
        self.tracker.point(aim, value(fields, "radius", 30.0))
        return "found=1"

    async def _measure(self, fields: Fields) -> str:
        samples, rate = int(value(fields, "samples", 1.0)), value(fields, "rate", 100.0)
        if samples < 1 or not RATES_HZ[0] <= rate <= RATES_HZ[1]:
            raise BadRequest(103, "samples or rate out of range")
        tracker, arm = self.tracker, self.tracker.arm
        tracker.check_ready()
        asked = fields.get("target")
        name = tracker.choose(asked)
        before = arm.joints_deg()
        await self.bridge.wait(samples / rate, self._look)
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
        answer |= {"n": samples, "t": self.bridge.t(), "age": 0.0, "az": az, "el": el, "r": r, "sr": 0.001}
        answer |= {"status": 0, "temp": self._air_c(), "P": PRESSURE_HPA, "H": HUMIDITY}
        answer |= {"mode": self.tracker.mode, "face": 1}
        if name is not None:
            answer["target"] = name
        return pairs(**(answer | odd))
