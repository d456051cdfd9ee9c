"""CESAPI (Peter G. Lane's Python port of the tracker's interface) as a client of an emScon server.

Called as `.counterparts/cesapi/bin/python cesapi_client_peer.py PORT X Y Z ...`: sets the tracker up as an operator
program does, goes to each place (mm), measures there, and prints one JSON line of what it was told for each command.
Its connection and its packets are used.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

from CESAPI import packet as tpi  # pyright: ignore[reportMissingImports]
from CESAPI.connection import Connection  # pyright: ignore[reportMissingImports]

ANSWER_S = 20.0


class Client:
    """One command at a time over CESAPI's stream of packets."""

    def __init__(self, port: int) -> None:
        self.connection = Connection()
        self.stream = self.connection.connect("127.0.0.1", port)

    def next(self, kind: int) -> Any:
        """The next packet of this kind; changes of status on the way are passed over."""
        end = time.monotonic() + ANSWER_S
        while time.monotonic() < end:
            if not self.stream.unreadCount():
                time.sleep(0.002)  # the stream has no call that waits
                continue
            found = self.stream.read()
            if tpi.packetType(found) == kind:
                return found
            if tpi.packetType(found) != tpi.ES_DT_SystemStatusChange:
                raise SystemExit(f"packet of type {tpi.packetType(found)}")
        raise SystemExit("no answer")

    def ask(self, name: str, **values: float) -> Any:
        """The answer to command `name` with its arguments filled in."""
        command = getattr(tpi, f"{name}CT")()
        for block in (command, *vars(command).values()):
            for key, value in values.items():
                if hasattr(block, key):
                    setattr(block, key, value)
        self.stream.write(command)
        found = self.next(tpi.ES_DT_Command)
        if found.packetInfo.command != command.packetInfo.command:
            raise SystemExit(f"answer to {found.packetInfo.command}, asked {name}")
        return found


def tell(name: str, *values: Any) -> None:
    sys.stdout.write(json.dumps([name, *values]) + "\n")


def measure(client: Client, place: list[float]) -> None:
    x, y, z = place
    tell("go", client.ask("GoPosition", dVal1=x, dVal2=y, dVal3=z, bUseADM=1).packetInfo.status)
    tell("start", client.ask("StartMeasurement").packetInfo.status)
    found = client.next(tpi.ES_DT_SingleMeasResult)
    point = [found.dVal1, found.dVal2, found.dVal3]
    std = [found.dStd1, found.dStd2, found.dStd3]
    air = [found.dTemperature, found.dPressure, found.dHumidity]
    tell("measured", found.packetInfo.status, found.measMode, point, std, air)


def main(port: int, places: list[list[float]]) -> None:
    client = Client(port)
    for name, values in (
        ("SetUnits", {"lenUnitType": 1, "angUnitType": 1, "pressUnitType": 1}),
        ("Initialize", {}),
        ("SetCoordinateSystemType", {"coordSysType": 0}),
        ("SetMeasurementMode", {"measMode": 0}),
        ("SetStationaryModeParams", {"lMeasTime": 500, "bUseADM": 1}),
        ("SetSearchParams", {"dSearchRadius": 30.0, "lTimeOut": 7500}),
        ("SetReflector", {"iInternalReflectorId": 7}),
    ):
        tell(name, client.ask(name, **values).packetInfo.status)
    air = client.ask("GetEnvironmentParams").environmentData
    tell("air", air.dPressure, air.dHumidity)
    tell("ready", client.ask("GetTrackerStatus").trackerStatus)
    found = client.ask("GetReflectors")
    known = [found]
    while len(known) < found.iTotalReflectors:
        known.append(client.next(tpi.ES_DT_Command))
    for each in known:
        name = each.cReflectorName.decode("utf-16-le").split("\0")[0]
        tell("reflector", each.packetInfo.packetHeader.lPacketSize, each.iInternalReflectorId, name)
    tell("serial", client.ask("GetSystemStatus").lTrackerSerialNumber)
    for place in places:
        measure(client, place)
    client.connection.disconnect()


if __name__ == "__main__":
    figures = [float(word) for word in sys.argv[2:]]
    main(int(sys.argv[1]), [figures[i : i + 3] for i in range(0, len(figures), 3)])
