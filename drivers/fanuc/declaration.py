"""The declaration of the driver of Fanuc robots, not run against hardware yet."""

from __future__ import annotations

from drivers.declaration import RobotDriver
from drivers.details import Details
from drivers.fanuc.arm import FanucArm
from drivers.fanuc.controller import alarm
from drivers.interfaces import RobotStatus


def _details(device: FanucArm, status: RobotStatus) -> Details:
    """Return the meaning of the alarm."""
    facility, number = divmod(status.error_number or 0, 1000)
    if not facility or status.mode == "manual":  # an enabled pendant is a separate alarm
        return Details()
    kind, text = alarm(facility, number)
    return Details(trouble=kind(text, raw=status.raw))


DRIVERS = (RobotDriver(name="fanuc", make=FanucArm, details=_details),)
