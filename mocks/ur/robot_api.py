"""Robot API of a simulated PolyScope X controller: HTTP, one request a connection.

Written from public clients of it, not from the driver. A change is refused with 403 in local mode. Paths of software
10.12 and 10.14 are 404 before it.
"""

from __future__ import annotations

import asyncio
import json
from typing import Any, Protocol

ROOT = "/universal-robots/robot-api"
ROBOT_MODES = {3: "POWER_OFF", 5: "IDLE", 7: "RUNNING"}
SAFETY_MODES = {1: "NORMAL", 3: "PROTECTIVE_STOP", 7: "EMERGENCY_STOP"}
PROGRAM_STATES = {1: "STOPPED", 2: "PLAYING", 4: "PAUSED"}


class Reported(Protocol):
    """Parts of a controller that the API reports or changes."""

    software: tuple[int, int, int, int]
    serial: str

    @property
    def is_local(self) -> bool: ...
    @property
    def robot_mode(self) -> int: ...
    @property
    def safety_mode(self) -> int: ...
    @property
    def runtime_state(self) -> int: ...
    def end_program(self) -> None: ...


class SimulatedRobotApi:
    """Requests about one controller."""

    def __init__(self, controller: Reported) -> None:
        self.controller = controller

    async def serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = (await reader.readuntil(b"\r\n\r\n")).decode("latin-1").split("\r\n")
        method, path, *_ = head[0].split(" ")
        fields = dict(line.lower().split(": ", 1) for line in head[1:] if ": " in line)
        body = await reader.readexactly(int(fields.get("content-length", "0")))
        status, answer = self._answer(method, path.removeprefix(ROOT), body)
        data = json.dumps(answer).encode()
        writer.write(
            f"HTTP/1.1 {status} .\r\nContent-Type: application/json\r\nContent-Length: {len(data)}\r\n"
            "Connection: close\r\n\r\n".encode()
            + data
        )
        await writer.drain()

    def _answer(self, method: str, path: str, body: bytes) -> tuple[int, dict[str, Any]]:
        if method == "GET":
            found = self._facts().get(path)
            return (404, {"message": "unknown"}) if found is None else (200, found)
        if (method, path) != ("PUT", "/program/v1/state"):
            return 404, {"message": "unknown"}
        if self.controller.is_local:
            return 403, {"message": "not in remote mode"}
        if json.loads(body) != {"action": "stop"}:
            return 400, {"message": "only a stop is simulated"}
        self.controller.end_program()
        return 200, {"state": "STOPPED", "message": "stopped"}

    def _facts(self) -> dict[str, dict[str, Any]]:
        robot = self.controller
        known: dict[str, dict[str, Any]] = {
            "/openapi.json": {"openapi": "3.1.0", "info": {"title": "Robot API", "version": "3.1.4"}},
            "/program/v1/state": {"state": PROGRAM_STATES[robot.runtime_state]},
        }
        if robot.software >= (10, 12):
            known |= {
                "/system/v1/controlmode": {"mode": "LOCAL" if robot.is_local else "REMOTE"},
                "/robotstate/v1/robotmode": {"mode": ROBOT_MODES[robot.robot_mode], "message": ""},
                "/robotstate/v1/safetymode": {
                    "mode": SAFETY_MODES.get(robot.safety_mode, "FAULT"),
                    "message": "",
                },
            }
        if robot.software >= (10, 14):
            known |= {
                "/versions/v1": {"marketingVersion": "{}.{}.{}".format(*robot.software)},
                "/system/v1/information": {"serialNumber": robot.serial},
            }
        return known
