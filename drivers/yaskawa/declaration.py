"""The declaration of the driver of Yaskawa robots, not run against hardware yet."""

from __future__ import annotations

from drivers.declaration import NumbersOption, RobotDriver
from drivers.details import Details
from drivers.errors import WrongMode
from drivers.interfaces import RobotStatus
from drivers.yaskawa.arm import YaskawaArm


def _details(device: YaskawaArm, status: RobotStatus) -> Details:
    """Return why the robot could not move, beyond what the status says."""
    trouble = device.trouble()
    told = isinstance(trouble, WrongMode) and (status.mode == "manual" or not status.motors_on)
    return Details(trouble=None if told else trouble)


DRIVERS = (
    RobotDriver(
        name="yaskawa",
        make=YaskawaArm,
        scheme="udp",
        options=(
            NumbersOption("pulses_per_deg", "`yaskawa`: pulses of the controller per degree of each joint."),
            NumbersOption("max_deg_s", "`yaskawa`: speed of each joint at VJ = 100 %, deg/s."),
        ),
        details=_details,
    ),
)
