"""`examine`: query every device of a cell, read-only, and report obstacles to a campaign.

Robot, instrument and computer are examined at the same time, each to its end even if another fails. Nothing is armed,
moved or set. While a campaign of this computer moves the robot, its devices are not queried.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor, as_completed
from contextlib import ExitStack
from pathlib import Path

from acquisition.cell.cell import Cell
from acquisition.cell.devices import Devices
from acquisition.errors import ClockJumped, RobotInUse
from acquisition.examination.computer import examine_computer, note_low_priority
from acquisition.examination.finding import Chart, CheckResult, Examination
from acquisition.examination.instrument import examine_instrument
from acquisition.examination.meeting import Place
from acquisition.examination.robot import examine_robot
from acquisition.run.orders.robot_lock import Mover

__all__ = ["CheckResult", "Examination", "examine", "note_low_priority"]

_CALENDAR_STEP_S = 1.0


def examine(
    cell: Cell,
    devices: Devices,
    *,
    record: Path = Path(),
    simulated: bool = False,
    progress: Callable[[str], None] = lambda step: None,
) -> Examination:
    """Examine the cell: its robot, instrument and computer.

    Parameters
    ----------
    record
        Folder for the records.
    simulated
        Whether the devices are simulators, whose clocks run at the speed in the cell file.
    progress
        Called with the next step; from several threads.
    """
    begun, calendar = time.monotonic(), time.time()
    charts = [Chart(name, progress) for name in ("robot", "instrument", "computer")]
    robot, instrument, computer = charts
    places = [
        Place("its simulator", True, cell.time_scale)
        if simulated
        else Place(device.url or "whoever works it")
        for device in (cell.robot, cell.instrument)
    ]
    with ThreadPoolExecutor(max_workers=len(charts)) as pool, ExitStack() as stack:
        under_way = {pool.submit(examine_computer, cell, computer, record): computer}
        try:
            if not simulated and not cell.robot.declared.by_hand:  # simulated cells may be any number
                stack.enter_context(Mover(cell.robot.url))
        except RobotInUse as error:
            robot.fault("lease", error)
            instrument.note("lease", "not asked, so as not to disturb the campaign that is running")
        else:
            if not simulated and not cell.robot.declared.by_hand:
                robot.ok("lease", "no campaign of this computer uses it")
            under_way |= {
                pool.submit(examine_robot, cell, devices.robot, robot, places[0]): robot,
                pool.submit(examine_instrument, cell, devices.instrument, instrument, places[1]): instrument,
            }
        for done in as_completed(tuple(under_way)):
            done.result()
            del under_way[done]
            if len(under_way) == 1:
                progress(f"waiting for the {next(iter(under_way.values())).device}")
    seconds = time.monotonic() - begun
    step_s = time.time() - calendar - seconds
    if abs(step_s) > _CALENDAR_STEP_S:
        computer.fault("calendar", ClockJumped(f"the calendar stepped by {step_s:+.1f} s meanwhile"))
    return Examination(cell.name, simulated, seconds, [each for chart in charts for each in chart.findings])
