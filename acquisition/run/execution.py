"""The execution of a run: the objects that exist only while devices are in use."""

from __future__ import annotations

from dataclasses import dataclass

from acquisition.run.orders.control import Control
from acquisition.run.orders.stop_orders import StopOrders
from acquisition.run.prompts.prompt_queue import PromptQueue
from acquisition.run.rig.rig import DevicePair
from acquisition.run.status import Pace


@dataclass
class CampaignExecution:
    """The parts of a run that exist only while devices are in use."""

    control: Control
    rig: DevicePair
    desk: PromptQueue
    pace: Pace
    noting: StopOrders
