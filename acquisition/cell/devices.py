"""The devices of a cell, opened by the names of its file."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

from acquisition.cell.cell import Cell
from drivers import open_instrument, open_robot
from drivers.interfaces import LengthMeter, Operator, PointMeter, RobotArm
from drivers.link import WireSink


class ManualJogging(Protocol):
    """The hands of a person at the arm of a simulated cell; angles of the model, deg."""

    def touch(self, target: str, base_target: str, near_deg: Sequence[float]) -> None:
        """Jog the arm until a ball of the tool sits in a cup, the arm nearly as in `near_deg`."""
        ...

    def jog(self, joints_deg: Sequence[float]) -> None:
        """Jog the arm to there."""
        ...


@dataclass(frozen=True)
class Devices:
    """The devices of a cell, not yet connected. `operator` None: prompts are answered through `Run.answer` only;
    `hands` None: whoever confirms has jogged the arm with their own; `person`: who works the devices of a simulated
    cell that are driven or read by hand.
    """

    robot: RobotArm
    instrument: PointMeter | LengthMeter
    operator: Operator | None = None
    hands: ManualJogging | None = None
    person: Operator | None = None


def open_devices(
    cell: Cell,
    *,
    operator: Operator | None = None,
    hands: ManualJogging | None = None,
    person: Operator | None = None,
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
        **({"reach_mm": _reach_mm(cell)} if cell.robot.declared.takes_reach else {}),
        **(
            {"axes": cell.robot.model.axes, "units": cell.robot.model.units}
            if cell.robot.declared.by_hand
            else {}
        ),
        **cell.robot.options,
    )
    instrument = open_instrument(
        cell.instrument.driver,
        instrument_url or cell.instrument.url,
        wire=wire,
        **(
            {"within_mm": cell.instrument.expected_within_mm} if cell.instrument.declared.takes_within else {}
        ),
        **cell.instrument.options,
    )
    return Devices(robot, instrument, operator, hands, person)


def _reach_mm(cell: Cell) -> float:
    """Farthest that a target can be from any axis: a driver that caps joint speeds keeps the path's speed with it."""
    links = sum(map(math.hypot, cell.robot.model.a, cell.robot.model.d))
    return links + max(math.hypot(*target) for target in cell.tool.targets.values())
