"""Measurement campaigns: planned, checked, executed and recorded.

A record survives a crash or a power cut. `read_cell` and `read_campaign` read the files. `Run` executes a campaign on
the devices of `open_devices`; `export` writes the data set of a record.
"""

from acquisition.campaign import Campaign, CampaignTable, campaign_from, read_campaign
from acquisition.cell import Cell, Devices, open_devices, read_cell
from acquisition.record import Event, State, export, export_events
from acquisition.run import (
    Clock,
    ExecutionOutcome,
    LeaseDeadline,
    Run,
    RunStatus,
    ScaledClock,
    checked_plan,
    pausing_on_interrupt,
    read_status,
)

__all__ = [
    "Campaign",
    "CampaignTable",
    "Cell",
    "Clock",
    "Devices",
    "Event",
    "ExecutionOutcome",
    "LeaseDeadline",
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
