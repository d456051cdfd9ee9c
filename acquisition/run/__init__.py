"""A run of a campaign: devices are moved and read, one durable reading at a time.

Start with `Run`.
"""

from acquisition.campaign.plan import Forecast
from acquisition.run.clock import Clock, ScaledClock
from acquisition.run.duration import Begin, at_once, forecast_of
from acquisition.run.interrupt import pausing_on_interrupt
from acquisition.run.orders.control import ON_REQUEST, STOPPED
from acquisition.run.orders.lease import LeaseDeadline
from acquisition.run.outcome import ExecutionOutcome
from acquisition.run.rig.device_state import NEVER_ASKED, ROLES, DeviceCondition, KnownDevice
from acquisition.run.run import PROMPT, Run, checked_plan
from acquisition.run.status import RunStatus, read_status

__all__ = [
    "NEVER_ASKED",
    "ON_REQUEST",
    "PROMPT",
    "ROLES",
    "STOPPED",
    "Begin",
    "Clock",
    "DeviceCondition",
    "ExecutionOutcome",
    "Forecast",
    "KnownDevice",
    "LeaseDeadline",
    "Run",
    "RunStatus",
    "ScaledClock",
    "at_once",
    "checked_plan",
    "forecast_of",
    "pausing_on_interrupt",
    "read_status",
]
