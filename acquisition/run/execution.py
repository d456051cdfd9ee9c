"""The execution of a run: what it has only while devices are in use."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.run.orders.control import Control
from acquisition.run.orders.noting import Noting
from acquisition.run.prompts.desk import Desk
from acquisition.run.rig.rig import Rig
from acquisition.run.status import Pace


@dataclass
class Execution:
    """The parts of a run that live only while devices are in use."""

    control: Control
    rig: Rig
    desk: Desk
    pace: Pace
    noting: Noting
