"""The declarations of the ABB drivers: RAPID sockets and simple_message.

They have not been run against hardware yet.
"""

from __future__ import annotations

from drivers.abb.arm import AbbArm
from drivers.abb.simple import AbbSimpleArm
from drivers.abb.simple_packets import parse_state
from drivers.declaration import RobotDriver
from drivers.details import Details
from drivers.errors import NotReady
from drivers.interfaces import RobotStatus


def _simple_details(device: AbbSimpleArm, status: RobotStatus) -> Details:
    """Return why motion is not possible although mode, motors and emergency stop are in order."""
    flags = parse_state(status.raw).flags
    well = flags.mode == "auto" and flags.motors_on and flags.emergency_stop is False
    if not well or (flags.motion_possible and not flags.in_error):
        return Details()
    return Details(
        trouble=NotReady(
            f"motion is not possible{f', error {flags.error_code}' if flags.in_error else ''}",
            raw=status.raw,
            what_to_do="Clear the error on the pendant and start all three programs of the controller.",
        )
    )


DRIVERS = (
    RobotDriver(name="abb", make=AbbArm),
    RobotDriver(name="abb-simple", make=AbbSimpleArm, details=_simple_details),
)
