"""Acquisition: what to measure, in which order, and a record that loses nothing. `acquisition.run` is the door."""

from acquisition.campaign import Campaign, campaign_from, read_campaign
from acquisition.cell import Cell, cell_from, read_cell
from acquisition.clock import Clock, ScaledClock
from acquisition.devices import Devices, open_devices
from acquisition.event import Event
from acquisition.export import export, export_events
from acquisition.interrupt import pausing_on_interrupt
from acquisition.lease import Lease
from acquisition.outcome import Outcome
from acquisition.run import Run, checked_plan
from acquisition.states import State
from acquisition.status import RunStatus, read_status

__all__ = [
    "Campaign",
    "Cell",
    "Clock",
    "Devices",
    "Event",
    "Lease",
    "Outcome",
    "Run",
    "RunStatus",
    "ScaledClock",
    "State",
    "campaign_from",
    "cell_from",
    "checked_plan",
    "export",
    "export_events",
    "open_devices",
    "pausing_on_interrupt",
    "read_campaign",
    "read_cell",
    "read_status",
]
