"""The dashboard server of a UR controller, TCP 29999: one line asks, one line answers.

The serial number is read here, and a program is stopped here if no other port answers; a controller whose dashboard is
closed works without. Universal Robots, "Dashboard server", commands `get serial number` (software 3.12 and 5.6 or
later), `is in remote control` (e-Series, 5.6 or later), `PolyscopeVersion`, `stop`.
"""

from __future__ import annotations

import re

from drivers.errors import LinkError
from drivers.link import Address, TcpLink, WireSink
from drivers.ur.deadlines import UrDeadlines
from drivers.ur.software import Software, software_of

_GREETING = b"Connected: Universal Robots Dashboard Server"
_SERIAL = re.compile(rb"[A-Za-z0-9-]{1,40}")
_COMMAND = "get serial number"
_VERSION = re.compile(rb"URSoftware (\d+\.\d+\.\d+)\D.*")


def read_serial(address: Address, device: str, deadlines: UrDeadlines, wire: WireSink | None) -> str:
    """Return the serial number of the arm, or an empty text if the dashboard does not report it.

    It never raises.
    """
    answer = order(address, _COMMAND, device, deadlines, wire)
    return answer.decode("ascii") if _SERIAL.fullmatch(answer) else ""


def read_software_version(
    address: Address, device: str, deadlines: UrDeadlines, wire: WireSink | None
) -> Software | None:
    """Return the software of the controller, None if the dashboard does not report it.

    It never raises.
    """
    found = _VERSION.fullmatch(order(address, "PolyscopeVersion", device, deadlines, wire))
    return software_of(found[1].decode("ascii")) if found else None


def order(
    address: Address, command: str, device: str, deadlines: UrDeadlines, wire: WireSink | None
) -> bytes:
    """Send a command and return its answer, or nothing if the dashboard does not answer.

    It never raises.
    """
    link = TcpLink(address, device, wire=wire)

    def line() -> bytes:
        return link.read_until(b"\n", command=command, deadline="reply_s", seconds=deadlines.reply_s).strip()

    try:
        link.open(connect_s=deadlines.connect_s)
        if line() != _GREETING:
            return b""
        link.send(command.encode() + b"\n", command=command, send_s=deadlines.send_s)
        return line()
    except LinkError:
        return b""
    finally:
        link.close()
