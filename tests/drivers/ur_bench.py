"""Cells with a simulated UR, and the driver connected to them."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from drivers import UrArm, UrDeadlines
from mocks.cell import CellThread

FAR = (90.0, -60.0, 30.0, 40.0, 50.0, 60.0)
PATIENT = UrDeadlines(connect_s=30.0, reply_s=30.0, start_s=30.0, stop_s=30.0, settle_s=30.0)
# A program that is over between two states was not seen to begin, and is waited for in full.
BRIEF = replace(PATIENT, start_s=1.0)


def connected(cell: CellThread, options: str = "", **keywords: Any) -> UrArm:
    arm = UrArm(cell.url("ur") + options, **({"deadlines": PATIENT} | keywords))  # type: ignore[arg-type]
    arm.connect()
    return arm


def creeping(cell: CellThread, options: str = "", **keywords: Any) -> UrArm:
    """Return an arm that takes most of a minute to FAR.

    Events on its way then happen there on a busy machine too. Its watchdog does not act if only this program
    was starved.
    """
    return connected(cell, options, **({"speed_deg_s": 2.0, "watchdog_s": 30.0} | keywords))
