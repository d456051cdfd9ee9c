"""The back door of a cell: one JSON object per line sets faults or asks for the truth. For tests and people.

    {"do": "state"} {"do": "truth"} {"do": "estop"} {"do": "restart"} {"do": "supervise"}
    {"do": "mode", "mode": "manual"} {"do": "motors", "on": false} {"do": "lose_first_reply", "on": true}
    {"do": "break_beam"} {"do": "restore_beam"} {"do": "seat", "target": "T1"} ("target": null: all nests)
    {"do": "hide", "target": "T2"} {"do": "show", "target": "T2"} {"do": "tracker", "state": "WARMING"}
    {"do": "weather", "on": false} {"do": "status_weather", "on": false} {"do": "odd_reading", "fields": {"status": 1}}
    {"do": "reboot"} {"do": "clock_step", "by_s": -3600} {"do": "stream", "rate": 50} (0: no more)
    {"do": "sums", "on": false} (bridges without checksums)
    {"do": "yaskawa", "remote": false, "hold": "pendant", "alarm": [4315, "..."], "error": true, "file_busy": true}
    {"do": "touch", "target": "T1", "base": "B1", "near_deg": [...]} {"do": "jog", "joints_deg": [...]} (of the model)

Answers `{"ok": true, ...}` or `{"ok": false, "error": "..."}`.
"""

from __future__ import annotations

import asyncio
import json
from collections.abc import Awaitable, Callable, Mapping
from inspect import isawaitable
from typing import Any, Protocol

from mocks.abb.controller import MODES, AbbController
from mocks.shared.tracker_device import TrackerDevice

Order = Callable[[dict[str, Any]], dict[str, Any] | Awaitable[None] | None]


class TrackerServer(Protocol):
    """The wire side of a tracker of any protocol."""

    odd: dict[str, Any]

    @property
    def tracker(self) -> TrackerDevice: ...
    def event(self, name: str) -> None: ...


class BackDoor:
    """Direct access to the devices of one cell that bypasses their protocols."""

    def __init__(
        self,
        abb: AbbController,
        faro: TrackerServer,
        further: Mapping[str, Order] | None = None,
    ) -> None:
        self.abb = abb
        self.faro = faro
        self.further = further or {}  # orders that the other devices of the cell understand

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := await reader.readline():
            try:
                answer = {"ok": True} | await self.do(json.loads(line))
            except (ValueError, KeyError, TypeError) as error:
                answer = {"ok": False, "error": f"{type(error).__name__}: {error}"}
            writer.write(json.dumps(answer).encode() + b"\n")
            await writer.drain()

    async def do(self, order: dict[str, Any]) -> dict[str, Any]:
        """Carry out one order.

        Raises
        ------
        ValueError, KeyError, TypeError
            The order is wrong.
        """
        what = order["do"]
        table: dict[str, Order] = {
            "state": self._state,
            "truth": lambda _: {"effects": self.faro.tracker.world.truth},
            "estop": lambda _: self.abb.arm.press_emergency_stop(),
            "supervise": lambda _: self.abb.arm.supervise(),
            "mode": self._mode,
            "motors": self._motors,
            "lose_first_reply": self._lose,
            "break_beam": self._break_beam,
            "restore_beam": self._restore_beam,
            "seat": self._seat,
            "hide": self._hide,
            "show": lambda o: self.faro.tracker.hidden.discard(o["target"]),
            "tracker": self._tracker,
            "weather": self._weather,
            "status_weather": lambda o: setattr(self.faro.tracker, "status_has_weather", bool(o["on"])),
            "odd_reading": lambda o: self.faro.odd.update(o["fields"]),
            **self.further,
        }
        if what not in table:
            raise ValueError(f"unknown order {what!r}; there are {', '.join(table)}")
        answer = table[what](order)
        return (await answer if isawaitable(answer) else answer) or {}

    def _state(self, order: dict[str, Any]) -> dict[str, Any]:
        arm, tracker = self.abb.arm, self.faro.tracker
        return {
            "t_s": arm.now(),
            "joints_deg": arm.joints_deg(),
            "previous_deg": arm.previous_deg,
            "sides": arm.sides,
            "mode": arm.mode,
            "motors_on": arm.motors_on,
            "emergency_stop": arm.emergency_stop,
            "moving": arm.moving,
            "tracker": tracker.state,
            "beam_broken": tracker.beam_broken,
            "seated": tracker.seated,
            "readings": tracker.readings,
            "targets_tracker_mm": {
                n: list(tracker.to_tracker(tracker.true_world(n))) for n in tracker.names()
            },
            "targets_world_mm": {n: list(tracker.true_world(n)) for n in tracker.names()},
        }

    def _mode(self, order: dict[str, Any]) -> None:
        if order["mode"] not in MODES:
            raise ValueError(f"mode is one of {', '.join(MODES)}")
        self.abb.arm.mode = order["mode"]
        self.abb.arm.wake()

    def _motors(self, order: dict[str, Any]) -> None:
        self.abb.arm.motors_on = bool(order["on"])
        self.abb.arm.wake()

    def _lose(self, order: dict[str, Any]) -> None:
        self.abb.lose_first_reply = bool(order["on"])

    def _break_beam(self, order: dict[str, Any]) -> None:
        self.faro.tracker.break_beam()
        self.faro.event("BEAM_BROKEN")

    def _restore_beam(self, order: dict[str, Any]) -> None:
        self.faro.tracker.beam_broken = False
        self.faro.event("TARGET_FOUND")

    def _known(self, name: str) -> str:
        if name not in self.faro.tracker.names():
            raise ValueError(f"target is one of {', '.join(self.faro.tracker.names())}")
        return name

    def _seat(self, order: dict[str, Any]) -> None:
        self.faro.tracker.seated = order["target"] and self._known(order["target"])

    def _hide(self, order: dict[str, Any]) -> None:
        self.faro.tracker.hidden.add(self._known(order["target"]))
        self.faro.event("TARGET_LOST")

    def _tracker(self, order: dict[str, Any]) -> None:
        if order["state"] not in ("OFF", "WARMING", "READY", "ERROR", "ESTOP"):
            raise ValueError("state is OFF, WARMING, READY, ERROR or ESTOP")
        self.faro.tracker.state = order["state"]

    def _weather(self, order: dict[str, Any]) -> None:
        self.faro.tracker.weather = bool(order["on"])
