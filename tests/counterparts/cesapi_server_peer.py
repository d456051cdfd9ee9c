"""CESAPI's packets as an emScon server: it understands the commands of a driver and writes the answers.

Called as `.counterparts/cesapi/bin/python cesapi_server_peer.py`: prints its port, serves one connection, and prints
each command as CESAPI understands it, one JSON line of number and arguments. The k-th measurement is of
(1000 k, -200, 50.25).
"""

from __future__ import annotations

import json
import socket
import sys
from typing import Any

from CESAPI.packet import SingleMeasResultT  # pyright: ignore[reportMissingImports]
from CESAPI.test import LTSimulator  # pyright: ignore[reportMissingImports]

START_MEASUREMENT, GET_REFLECTORS = 49, 42
REFLECTORS = ((1, "CCR-1.5in"), (7, "TBR-0.5in"))
TOLD = {
    "trackerStatus": 2,
    "weatherMonitorStatus": 2,
    "lTrackerSerialNumber": 390999,
    "dTemperature": 20.5,
    "dPressure": 1001.25,
    "dHumidity": 40.0,
}
SCATTER = {"dStd1": 0.01, "dStd2": 0.02, "dStd3": 0.03, "dStdTotal": 0.04}


def plain(block: Any) -> dict[str, Any]:
    """Arguments of a packet, those of its blocks among them."""
    out: dict[str, Any] = {}
    for name, value in vars(block).items():
        if name in ("packet", "packetInfo") or "__" in name:
            continue
        out.update({name: value} if isinstance(value, int | float) else plain(value))
    return out


def fill(block: Any, values: dict[str, float]) -> Any:
    for name, value in vars(block).items():
        if name in values:
            setattr(block, name, values[name])
        elif name.endswith("Data"):
            fill(value, values)
    return block


def received(connection: socket.socket, count: int) -> bytes:
    data = b""
    while len(data) < count:
        more = connection.recv(count - len(data))
        if not more:
            raise EOFError
        data += more
    return data


def serve(connection: socket.socket) -> None:
    codec = LTSimulator()  # never started: only its table from commands to packets is used
    measured = 0
    while True:
        head = received(connection, 4)
        data = head + received(connection, int.from_bytes(head, "little") - 4)
        command, answer = codec.packets(data)
        number = command.packetInfo.command
        sys.stdout.write(json.dumps([number, plain(command)]) + "\n")
        sys.stdout.flush()
        if number == GET_REFLECTORS:  # a packet for each
            for each, name in REFLECTORS:
                answer.iTotalReflectors, answer.iInternalReflectorId = len(REFLECTORS), each
                answer.cReflectorName = name.encode("utf-16-le")
                connection.sendall(answer.pack())
            continue
        connection.sendall(fill(answer, TOLD).pack())
        if number == START_MEASUREMENT:
            measured += 1
            point = {"dVal1": 1000.0 * measured, "dVal2": -200.0, "dVal3": 50.25}
            connection.sendall(fill(SingleMeasResultT(), TOLD | SCATTER | point).pack())


def main() -> None:
    with socket.create_server(("127.0.0.1", 0)) as server:
        sys.stdout.write(f"{server.getsockname()[1]}\n")
        sys.stdout.flush()
        connection, _ = server.accept()
        with connection:
            try:
                serve(connection)
            except (EOFError, ConnectionResetError):
                return


if __name__ == "__main__":
    main()
