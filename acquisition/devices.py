"""The devices of a cell, opened by the names of its file."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.cell import Cell
from drivers import open_instrument, open_robot
from drivers.interfaces import Operator, PointMeter, RobotArm
from drivers.link import WireSink


@dataclass(frozen=True)
class Devices:
    """Not yet connected. `operator` None: prompts are answered through `Run.answer` only."""

    robot: RobotArm
    instrument: PointMeter
    operator: Operator | None = None


def open_devices(
    cell: Cell,
    *,
    operator: Operator | None = None,
    robot_url: str | None = None,
    instrument_url: str | None = None,
    wire: WireSink | None = None,
) -> Devices:
    """Devices of `cell`, at its addresses or at those given (a simulated cell's). Raises ConfigError."""
    robot = open_robot(
        cell.robot.driver,
        robot_url or cell.robot.url,
        speed_mm_s=cell.robot.speed_mm_s,
        speed_deg_s=cell.robot.speed_deg_s,
        limits_deg=cell.robot.limits_deg,
        wire=wire,
    )
    instrument = open_instrument(cell.instrument.driver, instrument_url or cell.instrument.url, wire=wire)
    return Devices(robot, instrument, operator)
