"""The declarations of the drivers of Fanuc robots, not run against hardware yet."""

from __future__ import annotations

from dataclasses import replace

from drivers.declaration import RobotDriver
from drivers.details import Details
from drivers.fanuc.arm import FanucArm, FanucRmiArm
from drivers.fanuc.controller import alarm
from drivers.fanuc.rmi import override_of
from drivers.interfaces import RobotStatus


def _details(device: FanucArm, status: RobotStatus) -> Details:
    """Return the meaning of the alarm."""
    facility, number = divmod(status.error_number or 0, 1000)
    if not facility or status.mode == "manual":  # an enabled pendant is a separate alarm
        return Details()
    kind, text = alarm(facility, number)
    return Details(trouble=kind(text, raw=status.raw))


def _rmi_details(device: FanucArm, status: RobotStatus) -> Details:
    """Return the meaning of the alarm, and the general override."""
    return replace(_details(device, status), speed_share=override_of(status))


DRIVERS = (
    RobotDriver(name="fanuc", make=FanucArm, details=_details),
    RobotDriver(name="fanuc-rmi", make=FanucRmiArm, details=_rmi_details),
)
