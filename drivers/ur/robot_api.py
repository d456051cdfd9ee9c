"""The Robot API of PolyScope X (software 10.11 or later), HTTP, in place of the dashboard.

It reports local or remote control (10.12) and the serial number (10.14), and stops a program; a change needs remote
control (otherwise 403). It also loads and starts programs that are stored on the controller, which this driver does
not need: its programs are URScript, sent to 30001. Redirections are not followed.

Sources: for paths, versions and bodies, UniversalRobots/Universal_Robots_Client_Library
`src/ur/dashboard_client_implementation_x.cpp`. Universal Robots, PolyScope X SDK, "Resources". Not tried on a
controller.
"""

from __future__ import annotations

import json
import re
from contextlib import closing
from http.client import HTTPConnection, HTTPException
from typing import Any

from drivers.link import Address, WireSink
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.software import Software, software_of

PORT = 80
_ROOT = "/universal-robots/robot-api"
_LONGEST = 1_000_000
_SERIAL = re.compile(r"[A-Za-z0-9-]{1,40}")


class RobotApi:
    """Requests to the Robot API; an unanswered one gives None or an empty text, never an error."""

    def __init__(self, address: Address, device: str, deadlines: UrDeadlines, wire: WireSink | None) -> None:
        self._address, self._device, self._wire = address, device, wire
        self._deadlines = deadlines

    def software(self) -> Software | None:
        """Return the software of the controller, PolyScope X without a version before 10.14."""
        version = self._ask("/versions/v1").get("marketingVersion")
        known = software_of(version) if isinstance(version, str) else None
        if known is None and isinstance(self._ask("/openapi.json").get("info"), dict):
            return (10, 11)
        return known

    def in_remote_control(self) -> bool | None:
        """Return whether the controller accepts programs by network."""
        mode = self._ask("/system/v1/controlmode").get("mode")
        return {"REMOTE": True, "LOCAL": False}.get(mode) if isinstance(mode, str) else None

    def serial(self) -> str:
        """Return the serial number of the arm, or an empty text."""
        serial = self._ask("/system/v1/information").get("serialNumber")
        return serial if isinstance(serial, str) and _SERIAL.fullmatch(serial) else ""

    def stop(self) -> None:
        """Stop the program that runs."""
        self._ask("/program/v1/state", {"action": "stop"})

    def _ask(self, path: str, change: dict[str, str] | None = None) -> dict[str, Any]:
        """Return the JSON object of an answer, or an empty one."""
        method, body = ("GET", None) if change is None else ("PUT", json.dumps(change))
        self._log(">", f"{method} {path} {body or ''}".encode())
        host, port = self._address.host, self._address.port
        with closing(HTTPConnection(host, port, timeout=self._deadlines.reply_s)) as connection:
            try:
                connection.request(method, _ROOT + path, body, {"Content-Type": "application/json"})
                answer = connection.getresponse()
                data = answer.read(_LONGEST)
                self._log("<", f"{answer.status} ".encode() + data)
                found = json.loads(data) if 200 <= answer.status < 300 else {}
            except (OSError, HTTPException, ValueError, RecursionError):
                return {}
        return found if isinstance(found, dict) else {}

    def _log(self, direction: str, data: bytes) -> None:
        if self._wire is not None:
            self._wire.record(self._device, direction, data)
