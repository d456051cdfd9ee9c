"""Simulated cells with a Fanuc, and drivers for them, over every wire."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from drivers import FanucArm, FanucDeadlines
from mocks.cell import CellThread
from mocks.cell_file import CellFile

FAR = (90.0, 60.0, 30.0, 40.0, 50.0, 60.0)
SLOW = CellFile(robot="fanuc-lrmate200ic", time_scale=1.0, effects=("none",))
FAST = replace(SLOW, time_scale=10_000.0)
QUICK = FanucDeadlines(
    connect_s=30.0, reply_s=30.0, stop_s=30.0, settle_s=30.0, move_margin_s=60.0, gap_s=0.001
)
WIRES = {
    "mappdk": ("fanuc", ""),
    "mappdk-cal": ("fanuc", ""),
    "modbus-hmi": ("fanuc-modbus-hmi", "?modbus=hmi"),
    "modbus-io": ("fanuc-modbus-io", "?modbus=io"),
}


def cell_of(wire: str, file: CellFile) -> CellThread:
    return CellThread(file, stock=wire == "mappdk", devices=("fanuc",))


def arm_of(dialect: str, cell: CellThread, **arguments: Any) -> FanucArm:
    device, query = WIRES[dialect]
    return FanucArm(cell.url(device) + query, **({"deadlines": QUICK} | arguments))  # type: ignore[arg-type]
