"""The Fanuc on Modbus against programs that nobody here wrote: pymodbus's own client and server, mbpoll."""

from __future__ import annotations

import asyncio
import shutil
import subprocess
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest
from pymodbus.client import ModbusTcpClient
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from drivers import FanucArm, FanucDeadlines
from mocks.cell import CellThread
from mocks.cell_file import CellFile
from tests.drivers.waiting import PATIENCE_S, until

FAST = CellFile(robot="fanuc-lrmate200ic", time_scale=10_000.0, effects=("none",))
POSE = (10.5, -20.25, 30.0, -40.0, 50.0, 123.456)
QUICK = FanucDeadlines(gap_s=0.001)
FLOAT, INT = ModbusTcpClient.DATATYPE.FLOAT32, ModbusTcpClient.DATATYPE.INT32


@pytest.fixture
def cell() -> Iterator[CellThread]:
    with CellThread(FAST, devices=("fanuc",)) as cell:
        yield cell


@contextmanager
def client_of(cell: CellThread, profile: str) -> Iterator[ModbusTcpClient]:
    with ModbusTcpClient(
        "127.0.0.1", port=cell.port(f"fanuc-modbus-{profile}"), timeout=PATIENCE_S
    ) as client:
        yield client


def test_pymodbus_client_moves_the_simulator_by_registers(cell: CellThread) -> None:
    with client_of(cell, "hmi") as client:
        joints = client.convert_to_registers([*POSE, 0.0, 0.0, 0.0], FLOAT, word_order="little")
        client.write_registers(20, [*joints, 1])
        assert client.read_holding_registers(20, count=19).registers == [*joints, 1]
        client.write_register(60, 100)
        client.write_register(61, 7)
        client.write_register(62, 1007)  # go: the number and 1000
        until(lambda: client.read_holding_registers(64, count=1).registers == [7])
        assert client.read_holding_registers(62, count=4).registers == [0, 0, 7, 0]
        read = client.read_holding_registers(0, count=19).registers
        assert client.convert_from_registers(read[:12], FLOAT, word_order="little") == pytest.approx(
            POSE, abs=1e-5
        )
        assert read[18] == 1
        client.write_registers(500, [1, 2, 3])
        assert client.read_holding_registers(500, count=3).registers == [0, 0, 0]
        assert client.read_coils(0, count=8).bits == [False] * 8


def test_pymodbus_client_moves_the_simulator_by_signals(cell: CellThread) -> None:
    with client_of(cell, "io") as client:
        joints = client.convert_to_registers([round(q * 1e4) for q in POSE], INT, word_order="little")
        proof = 7919
        for word in (5, 100, *joints):
            proof = (31 * proof + word) % 65521
        client.write_registers(1, [100, 0, *joints, proof])
        client.write_register(0, 5 << 8 | 1)
        until(lambda: client.read_holding_registers(100, count=1).registers[0] == 5 << 8 | 0b101010)
        read = client.read_holding_registers(103, count=12).registers
        assert client.convert_from_registers(read, INT, word_order="little") == [round(q * 1e4) for q in POSE]


class PymodbusServer:
    """pymodbus's own server, whose registers are moved by the simplest of robot programs."""

    def __init__(self, profile: str) -> None:
        words = [0] * 200
        if profile == "hmi":
            words[18], words[70], words[109] = 1, 2, 2
        else:
            words[100], words[115] = 0b101000, 2
        blocks = [SimData(0, values=words, datatype=DataType.REGISTERS)]
        self._device = SimDevice(1, simdata=blocks, action=self._hmi if profile == "hmi" else self._io)
        self._ready = threading.Event()
        self._thread = threading.Thread(target=lambda: asyncio.run(self._serve()))
        self.port = 0

    async def _hmi(
        self, function: int, start: int, address: int, count: int, words: list[int], given: Any
    ) -> None:
        if given and address == 62 and given[0] == words[61] + 1000:
            words[0:19], words[64] = words[20:39], words[61]
            given[0] = 0  # the program takes `go` back

    async def _io(
        self, function: int, start: int, address: int, count: int, words: list[int], given: Any
    ) -> None:
        if given and address == 0 and given[0] & 1:
            words[103:115], words[100] = words[3:15], 0b101010 | given[0] & 0xFF00

    async def _serve(self) -> None:
        self._loop, self._end = asyncio.get_running_loop(), asyncio.Event()
        server = ModbusTcpServer(self._device, address=("127.0.0.1", 0))
        await server.serve_forever(background=True)
        self.port = server.transport.sockets[0].getsockname()[1]  # type: ignore[union-attr]
        self._ready.set()
        await self._end.wait()
        await server.shutdown()

    def __enter__(self) -> PymodbusServer:
        self._thread.start()
        assert self._ready.wait(PATIENCE_S)
        return self

    def __exit__(self, *unused: object) -> None:
        self._loop.call_soon_threadsafe(self._end.set)
        self._thread.join()


@pytest.mark.parametrize("profile", ["hmi", "io"])
def test_driver_with_pymodbus_server(profile: str) -> None:
    with PymodbusServer(profile) as server:
        arm = FanucArm(f"tcp://127.0.0.1:{server.port}?modbus={profile}", deadlines=QUICK)
        arm.connect()
        arm.arm()
        for i in range(5):
            target = (*POSE[:5], 10.0 * i)
            assert arm.move_to(target).joints_deg == pytest.approx(target, abs=1e-4)
            assert arm.position().joints_deg == pytest.approx(target, abs=1e-4)
        arm.disconnect()


@pytest.mark.skipif(shutil.which("mbpoll") is None, reason="mbpoll is not installed (apt install mbpoll)")
def test_mbpoll_reads_the_joints(cell: CellThread) -> None:
    arm = FanucArm(cell.url("fanuc"), deadlines=QUICK)
    arm.connect()
    arm.arm()
    arm.move_to(POSE)
    arm.disconnect()
    command = [
        "mbpoll",
        "-m",
        "tcp",
        "-p",
        str(cell.port("fanuc-modbus-hmi")),
        "-0",
        "-r",
        "0",
        "-c",
        "6",
        "-1",
    ]
    said = subprocess.run(
        [*command, "-t", "4:float", "127.0.0.1"],
        capture_output=True,
        text=True,
        check=True,
        timeout=PATIENCE_S,
    ).stdout
    read = [float(line.split()[-1]) for line in said.splitlines() if line.startswith("[")]
    assert read == pytest.approx(POSE, abs=1e-3)
