"""Acquisition: what to measure, in which order, and a record that loses nothing. It begins with `Run`."""

from acquisition.campaign import Campaign, campaign_from, read_campaign
from acquisition.cell import Cell, Devices, open_devices, read_cell
from acquisition.record import Event, State, export, export_events
from acquisition.run import (
    Clock,
    Lease,
    Outcome,
    Run,
    RunStatus,
    ScaledClock,
    checked_plan,
    pausing_on_interrupt,
    read_status,
)

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
    "checked_plan",
    "export",
    "export_events",
    "open_devices",
    "pausing_on_interrupt",
    "read_campaign",
    "read_cell",
    "read_status",
]
