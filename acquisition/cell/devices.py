"""The devices of a cell, opened according to the driver names of its file."""

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
    """A simulated person who jogs the arm of a simulated cell; angles of the model, deg."""

    def touch(self, target: str, base_target: str, near_deg: Sequence[float]) -> None:
        """Jog the arm until a ball of the tool sits in a cup, the arm nearly as in `near_deg`."""
        ...

    def jog(self, joints_deg: Sequence[float]) -> None:
        """Jog the arm to these joint angles, deg."""
        ...


@dataclass(frozen=True)
class Devices:
    """The devices of a cell, not yet connected.

    Attributes
    ----------
    operator
        Answers prompts; None if only `Run.answer` does.
    hands
        Jogs the arm; None if the person who confirms a prompt has jogged it.
    person
        Works the devices of a simulated cell that are driven or read by hand.
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
    """Open the devices of `cell` without connecting them.

    The URLs of a simulated cell may replace those of the cell file.

    Raises
    ------
    ConfigError
        A driver is unknown or refuses its options.
    """
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
    """Compute the largest distance of a target from any axis, mm.

    A driver that caps joint speeds uses it to keep the speed of the path.
    """
    links = sum(map(math.hypot, cell.robot.model.a, cell.robot.model.d))
    return links + max(math.hypot(*target) for target in cell.tool.targets.values())
