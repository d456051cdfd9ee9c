"""Simulated Fanuc: MAPPDK on two ports, Modbus TCP in two layouts, RMI."""

from __future__ import annotations

from mocks.fanuc.controller import FanucController
from mocks.fanuc.mappdk import MappdkServer
from mocks.fanuc.modbus import HmiImage, IoImage, ModbusServer
from mocks.fanuc.rmi import RmiServer
from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import CellClock
from mocks.shared.sockets import Endpoint, Servers
from mocks.world.robots import Robot


class Fanuc:
    """One controller."""

    def __init__(self, arm: ArmDevice, clock: CellClock, robot: Robot, *, stock: bool) -> None:
        self.controller = FanucController(arm, clock, robot)
        self.mappdk = MappdkServer(self.controller, stock=stock)
        self.rmi = RmiServer(self.controller)
        self.modbus = {
            "fanuc-modbus-hmi": ("modbus-hmi", ModbusServer(HmiImage(self.controller))),
            "fanuc-modbus-io": ("modbus-io", ModbusServer(IoImage(self.controller))),
        }

    async def listen(self, servers: Servers, port: int) -> list[Endpoint]:
        """Start all servers except that of RMI, the first at `port`; 0 is a free port.

        Raises
        ------
        OSError
            The port is taken.
        """
        one, two = await servers.listen_pair(self.mappdk.serve_main, self.mappdk.serve_logger, port)
        second = "mappdk" if self.mappdk.stock else "mappdk-cal"
        ends = [Endpoint("fanuc", "mappdk", one), Endpoint("fanuc-logger", second, two)]
        for name, (kind, server) in self.modbus.items():
            ends.append(Endpoint(name, kind, await servers.listen(server.serve)))
        return ends
