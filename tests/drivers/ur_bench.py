"""Cells with a simulated UR, and the driver connected to them."""

from __future__ import annotations

from typing import Any

from drivers import UrArm, UrDeadlines
from mocks.cell import CellThread

FAR = (90.0, -60.0, 30.0, 40.0, 50.0, 60.0)
HASTY = UrDeadlines(reply_s=0.4, start_s=0.3, stop_s=0.5, settle_s=0.1, move_factor=0.0, move_margin_s=0.3)
PATIENT = UrDeadlines(connect_s=30.0, reply_s=30.0, start_s=30.0, stop_s=30.0, settle_s=30.0)


def connected(cell: CellThread, options: str = "", **keywords: Any) -> UrArm:
    arm = UrArm(cell.url("ur") + options, **({"deadlines": PATIENT} | keywords))  # type: ignore[arg-type]
    arm.connect()
    return arm


def creeping(cell: CellThread, options: str = "", **keywords: Any) -> UrArm:
    """An arm that takes most of a minute to FAR: what shall happen on its way happens there, on a busy machine too.

    Nor does its watchdog bark when only this program was starved.
    """
    return connected(cell, options, **({"speed_deg_s": 2.0, "watchdog_s": 30.0} | keywords))
