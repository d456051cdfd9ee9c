"""One cell: a world and the servers of all its devices, in one event loop on loopback."""

from __future__ import annotations

import asyncio
import threading
from collections.abc import Callable, Sequence
from dataclasses import replace
from types import TracebackType
from typing import Any

import numpy as np

from mocks.abb.controller import AbbController
from mocks.abb.rws import RwsServer
from mocks.abb.simple import SimpleMessageServers
from mocks.backdoor import BackDoor
from mocks.cell_file import CellFile
from mocks.creaform.ctrack import CTrackBridge, CTrackDevice
from mocks.dialects import speak
from mocks.fanuc.wires import Fanuc
from mocks.faro.bridge import FaroBridge
from mocks.leica.bridge import LeicaBridge
from mocks.leica.device import LeicaDevice
from mocks.leica.emscon import EmsconServer
from mocks.manual.operator import SimulatedPerson
from mocks.misplaced import offsets, true_nests
from mocks.renishaw.qc20w import BallbarBridge, BallbarDevice
from mocks.shared.arm_device import ArmDevice
from mocks.shared.clock import CellClock, DeviceClock
from mocks.shared.jogging import jog_into
from mocks.shared.mbp_bridge import MbpBridge
from mocks.shared.sockets import Endpoint, Servers
from mocks.shared.tracker_device import TrackerDevice
from mocks.ur.controller import UrController
from mocks.world import ROBOTS, Robot, Session, World, random_label
from mocks.world.robot_file import robot_of, table_of
from mocks.world.robots import Counting
from mocks.yaskawa.controller import YaskawaController
from mocks.yaskawa.hses import HsesServer

LABEL_STREAM, CLOCK_STREAM = 22, 23


def robot_in(cell: CellFile) -> Robot:
    """Return the robot of a cell file.

    It is the simulator's own robot of this name if there is one, or the robot of the robot file. A wrong file is a
    ValueError.
    """
    if cell.robot_file is None and cell.robot in ROBOTS:
        own = ROBOTS[cell.robot]
        return replace(own, counting=Counting()) if cell.joint_coupling == "none" else own
    return robot_of(cell.robot_file or table_of(cell.robot), cell.joint_coupling, cell.limits_deg)


def make_world(cell: CellFile) -> World:
    """Return the world of a cell file; without effects named, one label is drawn from the seed."""
    robot = robot_in(cell)
    labels: Sequence[str] = cell.effects
    if not labels:
        labels = [random_label(robot, np.random.default_rng([cell.seed, LABEL_STREAM]))]
    cog = cell.tool_cog_mm
    return World(
        robot,
        cell.seed,
        [label for label in labels if label != "none"],
        size=cell.effect_size,
        station_mm=cell.station_mm,
        targets=cell.targets,
        misplaced_mm=offsets(cell),
        tool_mass_kg=cell.tool_mass_kg,
        tool_cog_mm=None if cog is None else (cog[0], cog[1], cog[2]),
        session=Session(cell.readings, cell.seconds_per_reading),
    )


class Cell:
    """Devices of one cell; `start` and `stop` belong to the running event loop."""

    def __init__(
        self,
        cell: CellFile,
        *,
        stock: bool = False,
        devices: Sequence[str] = ("abb", "faro"),
        clock: CellClock | None = None,
    ) -> None:
        self.clock = clock or CellClock(cell.time_scale)
        self.world = make_world(cell)
        robot = self.world.robot
        self.arm = ArmDevice(self.clock.now, robot.limits_deg, robot.sliding)
        within = cell.limits_deg or robot.limits_deg
        self.arm.put(robot.counting.to_model([min(max(0.0, low), high) for low, high in within]))
        nests = true_nests(cell)
        self.tracker = TrackerDevice(self.world, self.arm, self.clock, nests)
        self.abb = AbbController(self.arm, self.clock, robot, stock=stock)
        self.rws = RwsServer(self.arm, robot)
        self.abb_simple = SimpleMessageServers(self.arm, self.clock, robot.counting)
        self.fanuc = Fanuc(self.arm, self.clock, robot, stock=stock)
        self.yaskawa = YaskawaController(self.arm, self.clock, robot, cell.pulses_per_deg, cell.max_deg_s)
        self.ur_clock = DeviceClock(self.clock)
        self.ur = UrController(self.arm, self.ur_clock, self.world)
        if cell.serial:
            self.abb.serial = self.ur.serial = cell.serial
        self.faro = FaroBridge(self.tracker, self.clock)
        self.ctrack = CTrackBridge(CTrackDevice(self.world, self.arm, self.clock, nests, cell.normals))
        self.qc20w = BallbarBridge(BallbarDevice(self.world, self.arm, self.clock, nests, cell.ballbar_mm))
        self.person = SimulatedPerson(cell, self.arm, self.tracker, self.clock, robot)
        self.at960 = LeicaDevice(self.world, self.arm, self.clock, nests, cell.normals)
        self.leica, self.emscon = LeicaBridge(self.at960), EmsconServer(self.at960)
        self.backdoor = BackDoor(
            self.abb,
            self.leica if "leica" in devices else self.emscon if "emscon" in devices else self.faro,
            self.ur.orders()
            | self.rws.orders()
            | self.ctrack.orders()
            | self.qc20w.orders()
            | self.leica.orders()
            | self.emscon.orders()
            | self.fanuc.rmi.orders()
            | {
                "yaskawa": self.yaskawa.put,
                "touch": self._touch,
                "jog": lambda order: self.arm.put(order["joints_deg"]),
                "restart": self._restart,
                "reboot": self._reboot,
                "clock_step": self._clock_step,
                "stream": self._careless_stream,
                "sums": self._sums,
            },
        )
        self.devices = devices
        self._servers = Servers()
        if cell.dialect:
            speak(self, cell.dialect)
        rng = np.random.default_rng([cell.seed, CLOCK_STREAM])
        for own in self._clocks:
            own.offset_s = float(rng.uniform(-1.0, 1.0)) * cell.clock_offset_s
            own.rate = float(rng.uniform(-1.0, 1.0)) * 1e-6 * cell.clock_rate_ppm

    # -- orders of the back door that mean every device ----------------------------------------------------

    @property
    def bridges(self) -> tuple[MbpBridge, ...]:
        alone = (each.bridge for each in (self.faro, self.leica, self.ctrack, self.qc20w))
        return *alone, self.qc20w.serial

    @property
    def _clocks(self) -> tuple[DeviceClock, ...]:
        return self.ur_clock, *(bridge.clock for bridge in self.bridges)

    async def _reboot(self, order: dict[str, Any]) -> None:
        """Switch the devices off and on.

        Connections are reset, counters and clocks start again, and instruments are not initialised.
        """
        for each in (self.faro, self.leica, self.ctrack, self.qc20w):
            each.reboot()
        self.ur_clock.restart()
        await self._restart(order)

    async def _restart(self, order: dict[str, Any]) -> None:
        """Put the robot in order and start its programs again, as a person does."""
        self.abb_simple.restart()
        self.yaskawa.restart()
        await self.abb.restart()

    def _touch(self, order: dict[str, Any]) -> None:
        """Jog the arm until a ball of the tool sits in a cup of the base, as a person does."""
        ball = self.qc20w.device.balls[order["base"]]
        jog_into(self.world, self.arm, self.clock, order["target"], ball, order["near_deg"])

    def _clock_step(self, order: dict[str, Any]) -> None:
        """Step every device's clock by `by_s` seconds."""
        for clock in self._clocks:
            clock.offset_s += float(order["by_s"])

    def _careless_stream(self, order: dict[str, Any]) -> None:
        """Let every bridge push samples to the connected client, even if it did not request them.

        Rate 0 ends the stream.
        """
        fields = {key: str(value) for key, value in order.items()}
        for bridge in self.bridges:
            bridge.stream(fields if order["rate"] else None, careless=True)

    def _sums(self, order: dict[str, Any]) -> None:
        """Let every bridge send its lines with a checksum, or without."""
        for bridge in self.bridges:
            bridge.sums = bool(order["on"])

    # -- serving ------------------------------------------------------------------------------------------

    async def start(self, port: int = 0) -> list[Endpoint]:
        """Listen on `port` with the first device, and on free ports with the others.

        Port 0 is a free one.

        Raises
        ------
        OSError
            The port is taken.
        """
        ends: list[Endpoint] = []
        try:
            if "abb" in self.devices:
                one, two = await self._servers.listen_pair(
                    self.abb.serve_main, self.abb.serve_background, port
                )
                stock = self.abb.stock
                second = await self._second_channel()
                query = second.query if second is not None else ""
                ends.append(Endpoint("abb", "open_abb" if stock else "calsrv", one, query=query))
                ends.append(Endpoint("abb-background", "open_abb-log" if stock else "calsrv", two))
                ends += [] if second is None else [second]
            if "abb-simple" in self.devices:
                ends += await self.abb_simple.listen(self._servers, port if not ends else 0)
            if "fanuc" in self.devices:
                ends += await self.fanuc.listen(self._servers, port if not ends else 0)
            if "fanuc-rmi" in self.devices:
                ends += await self.fanuc.rmi.listen(self._servers, port if not ends else 0)
            if "ur" in self.devices:
                ends += await self.ur.listen(self._servers, port if not ends else 0)
            if "yaskawa" in self.devices:
                server = HsesServer(self.yaskawa)
                ends.append(await server.listen(self._servers, port if not ends else 0))
            if "faro" in self.devices:
                first = port if not ends else 0
                ends.append(
                    Endpoint("faro", "mbp1", await self._servers.listen(self.faro.bridge.serve, first))
                )
            for name, protocol, handler in (
                ("leica", "mbp1", self.leica.bridge.serve),
                ("emscon", "emscon", self.emscon.serve),
                ("ctrack", "mbp1", self.ctrack.bridge.serve),
                ("qc20w", "mbp1", self.qc20w.bridge.serve),
                ("manual", "jsonl", self.person.serve),
            ):
                if name in self.devices:
                    first = port if not ends else 0
                    ends.append(Endpoint(name, protocol, await self._servers.listen(handler, first)))
            if "qc20w-serial" in self.devices:
                ends.append(await self.qc20w.open_pty())
            ends.append(Endpoint("backdoor", "jsonl", await self._servers.listen(self.backdoor.serve)))
        except OSError:
            await self.stop()
            raise
        return ends

    async def _second_channel(self) -> Endpoint | None:
        """Listen with the ABB controller's web server, whose port the RAPID address names."""
        if "abb-rws" not in self.devices:
            return None
        old, tls = self.rws.old, None if self.rws.old else self.rws.context
        port = await self._servers.listen(self.rws.serve, 0, tls)
        query = f"rws={port}&fingerprint={self.rws.fingerprint}"
        return Endpoint("abb-rws", "rws1" if old else "rws2", port, query=query)

    async def stop(self) -> None:
        """Close every server and connection."""
        self.qc20w.close_pty()
        await self.ur.close()
        await self._servers.close()


class CellThread:
    """A cell in a separate thread, for tests.

    Use it as `with CellThread(CellFile(...)) as cell` and connect to `cell.url("abb")`.
    """

    def __init__(
        self,
        cell: CellFile,
        *,
        stock: bool = False,
        devices: Sequence[str] = ("abb", "faro"),
        clock: CellClock | None = None,
    ) -> None:
        self._make: Callable[[], Cell] = lambda: Cell(cell, stock=stock, devices=devices, clock=clock)
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._main()))
        self._loop: asyncio.AbstractEventLoop | None = None
        self._finish: asyncio.Event | None = None
        self.endpoints: list[Endpoint] = []
        self.cell: Cell | None = None

    async def _main(self) -> None:
        self._loop, self._finish = asyncio.get_running_loop(), asyncio.Event()
        try:
            self.cell = self._make()
            self.endpoints = await self.cell.start()
        finally:
            self._ready.set()
        await self._finish.wait()
        await self.cell.stop()

    def __enter__(self) -> CellThread:
        self._thread.start()
        self._ready.wait()
        if not self.endpoints:
            self._thread.join()
            raise RuntimeError("the cell did not start")
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        assert self._loop is not None
        assert self._finish is not None
        self._loop.call_soon_threadsafe(self._finish.set)
        self._thread.join()

    def port(self, device: str) -> int:
        return self._endpoint(device).port

    def url(self, device: str) -> str:
        return self._endpoint(device).url

    def _endpoint(self, device: str) -> Endpoint:
        return next(end for end in self.endpoints if end.device == device)

    def do(self, what: str, **order: Any) -> dict[str, Any]:
        """Carry out an order of the back door in the cell's own loop."""
        assert self._loop is not None
        assert self.cell is not None
        doing = asyncio.run_coroutine_threadsafe(self.cell.backdoor.do({"do": what} | order), self._loop)
        return doing.result(timeout=10)
