"""Cells with a simulated UR, and the driver connected to them."""

from __future__ import annotations

from drivers import UrArm, UrDeadlines
from mocks.cell import CellThread
from mocks.cell_file import CellFile

FAR = (90.0, -60.0, 30.0, 40.0, 50.0, 60.0)
SLOW = CellFile(robot="ur5", time_scale=1.0, effects=("none",))  # moves take seconds
FAST = CellFile(robot="ur5", time_scale=5000.0, effects=("none",))
HASTY = UrDeadlines(reply_s=0.4, start_s=0.3, stop_s=0.5, settle_s=0.1, move_factor=0.0, move_margin_s=0.3)


def connected(cell: CellThread, options: str = "", **keywords: object) -> UrArm:
    arm = UrArm(cell.url("ur") + options, **keywords)  # type: ignore[arg-type]
    arm.connect()
    return arm
