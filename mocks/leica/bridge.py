"""Simulated bridge of a Leica AT960 with LMF: MBP/1 lines on TCP over a LeicaDevice."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from mocks.leica.device import HUMIDITY, PRESSURE_HPA, REFLECTORS_MM, LeicaDevice
from mocks.shared.mbp import BadRequest, pairs, place, value
from mocks.shared.mbp_bridge import Fields, MbpBridge

RATES_HZ = (1.0, 1000.0)
FACES = {"1": 1.0, "2": 1.0, "BOTH": 2.0}  # and how much longer it takes


class LeicaBridge:
    """Wire side of the AT960.

    `odd` holds faults of single readings that the back door sets; one MEASURE uses them up.
    """

    def __init__(self, tracker: LeicaDevice) -> None:
        self.tracker = tracker
        self.odd: dict[str, Any] = {}
        self._aimed: np.ndarray | None = None
        self.bridge = MbpBridge(
            tracker.clock,
            pairs(proto=1, kind="TRACKER", vendor="Leica", model="AT960-MR", serial="750001", fw="2.3")
            + " "
            + pairs(bridge="1.0", crc=1, units="mm,deg,C,hPa", sim=1),
            self._state,
            {"WEATHER": self._weather, "MODE": self._mode, "TARGET": self._target, "LEVEL": self._level},
            {
                "INIT": self._init,
                "HOME": self._home,
                "POINT": self._point,
                "SEARCH": self._search,
                "MEASURE": self._measure,
            },
            tracker.sample,
        )

    def event(self, name: str) -> None:
        self.bridge.event(name)

    def reboot(self) -> None:
        self.tracker.state = "OFF"
        self.bridge.reboot()

    def orders(self) -> dict[str, Any]:
        """Return the orders of the back door that only this tracker has."""
        return {"power_lock": lambda order: setattr(self.tracker, "power_lock", bool(order["on"]))}

    # -- short commands -----------------------------------------------------------------------------------

    def _air(self) -> str:
        return pairs(T=self.tracker.air_c(), P=PRESSURE_HPA, H=HUMIDITY)

    def _state(self) -> str:
        tracker = self.tracker
        state = "BUSY" if self.bridge.busy and tracker.state == "READY" else tracker.state
        return f"state={state} " + (self._air() if tracker.weather and tracker.status_has_weather else "")

    def _weather(self, fields: Fields) -> str:
        if fields.get("source") == "MAN":
            self.tracker.assumed = value(fields, "T"), value(fields, "P")
        elif not self.tracker.weather:
            raise BadRequest(204, "no weather data")
        elif fields.get("source") == "STATION":
            self.tracker.assumed = None
        return self._air() + " n=1.000270"

    def _mode(self, fields: Fields) -> str:
        if fields.get("distance") != "ADM":
            raise BadRequest(103, "this tracker measures absolute distances only: distance=ADM")
        if fields.get("profile", "STANDARD") not in ("FAST", "STANDARD", "PRECISE"):
            raise BadRequest(103, "profile is FAST, STANDARD or PRECISE")
        return ""

    def _target(self, fields: Fields) -> str:
        diameter = value(fields, "d")
        if diameter not in REFLECTORS_MM:
            raise BadRequest(103, f"no reflector of {diameter:g} mm")
        self.tracker.reflector_mm = diameter
        return pairs(type=fields.get("type", "SMR"), d=diameter)

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
        self.tracker.lost = False
        return ""

    async def _point(self, fields: Fields) -> str:
        self._aimed = np.array(place(fields))
        await self.bridge.wait(1.0, self._look)
        if value(fields, "find", 0.0) == 0.0:
            return "found=0"
        self.tracker.point(self._aimed, value(fields, "radius", 30.0))
        return "found=1"

    async def _search(self, fields: Fields) -> str:
        if self._aimed is None:
            raise BadRequest(110, "point first")
        await self.bridge.wait(2.0, self._look)
        name = self.tracker.point(self._aimed, value(fields, "radius"))
        x, y, z = self.tracker.to_tracker(self.tracker.true_world(name))
        return pairs(found=1, x=float(x), y=float(y), z=float(z))

    async def _measure(self, fields: Fields) -> str:
        samples, rate = int(value(fields, "samples", 1.0)), value(fields, "rate", 100.0)
        face = fields.get("face", "1")
        if samples < 1 or not RATES_HZ[0] <= rate <= RATES_HZ[1] or face not in FACES:
            raise BadRequest(103, "samples, rate or face out of range")
        tracker, arm = self.tracker, self.tracker.arm
        tracker.check_ready()
        asked = fields.get("target")
        name = tracker.choose(asked)
        before = arm.joints_deg()
        await self.bridge.wait(FACES[face] * samples / rate, self._look)
        tracker.check_ready()
        if tracker.held != name:
            raise BadRequest(302, "target lost", retry=True)
        if arm.joints_deg() != before and name not in tracker.nests:
            raise BadRequest(303, "target moved during averaging", retry=True)
        point, scatter = tracker.average(name, samples)
        return self._reading(point, scatter, samples, face, asked if tracker.seated is None else None)

    def _reading(
        self, point: np.ndarray, scatter: np.ndarray, samples: int, face: str, name: str | None
    ) -> str:
        odd, self.odd = self.odd, {}
        x, y, z = (float(v) for v in point)
        r = math.hypot(x, y, z)
        answer: dict[str, object] = {"x": x, "y": y, "z": z}
        answer |= {key: round(float(v), 6) for key, v in zip(("sx", "sy", "sz"), scatter, strict=True)}
        answer |= {"n": samples, "t": self.bridge.t(), "age": 0.0, "r": r, "status": 0}
        answer |= {
            "temp": self.tracker.air_c(),
            "P": PRESSURE_HPA,
            "H": HUMIDITY,
            "mode": "ADM",
            "face": face,
        }
        if name is not None:
            answer["target"] = name
        return pairs(**(answer | odd))
