"""The identity of a device against the cell file: its maker and model, as it reports them itself.

Makers write one model in many spellings ("IRB 120-3/0.6", "LR Mate 200iC"); here the name of the robot file must be
found in what the controller says, whatever signs lie between its letters, and must end there: an IRB 1200 is no IRB
120. A protocol that reports no model proves nothing, and nothing is held against it. A robot file of the user's own
may bear any name; there the maker alone counts.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from acquisition.cell.cell import Cell
from calib.arm import built_in_robots
from drivers import INSTRUMENTS
from drivers.errors import ConfigError
from drivers.interfaces import Identity


class OtherDevice(ConfigError):
    """The device at the address is not the one that the cell file names."""

    code = 6102
    advice = "Correct model, driver or url in the cell file, or connect the device that it names."


@dataclass(frozen=True)
class Match:
    """`agrees` None: the device does not report enough to say. `text`: what was compared."""

    agrees: bool | None
    text: str


def match_robot(cell: Cell, who: Identity) -> Match:
    """The controller's own words against `[robot] model`."""
    robot = cell.robot.model
    if cell.robot.declared.by_hand:
        return Match(None, f"{robot.name} by the cell file; nobody but its type plate says so")
    if _plain(who.maker) != _plain(robot.maker):
        return Match(False, f"{who.maker} answers, the cell file names {robot.name} of {robot.maker}")
    if not who.model:
        return Match(None, f"{robot.name} by the cell file; this dialect does not report the model")
    if is_model(robot.name, robot.maker, who.model):
        return Match(True, f"{who.model}: that is {robot.name}")
    if robot.name not in built_in_robots():
        return Match(None, f"{who.model} answers; {robot.name} is a robot file of your own")
    return Match(False, f"{who.model} answers, the cell file names {robot.name}")


def match_instrument(cell: Cell, who: Identity) -> Match:
    """The maker that the instrument or its bridge reports, against the one that the driver is for."""
    driver = cell.instrument.driver
    wanted, reported = cell.instrument.declared.maker, _plain(who.maker)
    if cell.instrument.declared.by_hand:
        return Match(None, "read by a person: nobody but its type plate says what it is")
    if _plain(wanted) in reported:
        return Match(True, f"{who.maker}, for which the driver '{driver}' is made")
    if any(_plain(each.maker) in reported for each in INSTRUMENTS.values() if each.maker):
        return Match(False, f"{who.maker} {who.model} answers, the driver '{driver}' is for {wanted}")
    return Match(None, f"the maker is reported as {who.maker!r}, the driver '{driver}' is for {wanted}")


def check_identity(cell: Cell, role: str, who: Identity) -> None:
    """Refuse another device before anything moves. `role`: robot or instrument. Raises OtherDevice."""
    match = match_robot(cell, who) if role == "robot" else match_instrument(cell, who)
    if match.agrees is False:
        raise OtherDevice(match.text, device=role, command="identify")


def is_model(name: str, maker: str, model: str) -> bool:
    """Whether a controller's `model` means the robot `name` (with or without its maker in front)."""
    letters = _plain(name).removeprefix(_plain(maker))
    pattern = r"[\W_]*".join(letters)
    return re.search(rf"(?<![a-z0-9]){pattern}(?![a-z0-9])", model.casefold()) is not None


def _plain(text: str) -> str:
    return re.sub(r"[\W_]+", "", text.casefold())
