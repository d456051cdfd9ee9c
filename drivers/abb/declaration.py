"""The declarations of the ABB drivers: RAPID sockets and simple_message.

RAPID sockets have Robot Web Services as a second channel.

They have not been run against hardware yet.
"""

from __future__ import annotations

from drivers.abb.arm import AbbArm
from drivers.abb.simple import AbbSimpleArm
from drivers.abb.simple_packets import parse_state
from drivers.declaration import RobotDriver, TextOption
from drivers.details import Details
from drivers.errors import NotReady
from drivers.interfaces import RobotArm, RobotStatus

_OPTIONS = (
    TextOption(
        "rws_fingerprint",
        words="`abb` with `?rws=443` in url: SHA-256 of the controller's certificate, which must not change.",
    ),
    TextOption(
        "rws_user",
        words="`abb` with `?rws=443` in url: who asks; left out: the user of the factory, Default User.",
    ),
    TextOption(
        "rws_password_file",
        words="`abb` with `?rws=443` in url: file with the password, mode 0600; left out: the password of the factory.",
    ),
)


def _details(device: RobotArm, status: RobotStatus) -> Details:
    """Return the report of the second channel; raise an error if the channels differ."""
    if not isinstance(device, AbbArm) or device.second is None:
        return Details()
    seen = device.second.fresh("status")
    device.second.compare(seen, device.position().joints_deg)
    program = "runs" if seen.runs else "is stopped"
    told = (
        f"RobotWare {device.second.version} by Robot Web Services: joints agree, the RAPID program {program}"
    )
    return Details(second_channel=told)


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
    RobotDriver(name="abb", make=AbbArm, options=_OPTIONS, details=_details),
    RobotDriver(name="abb-simple", make=AbbSimpleArm, details=_simple_details),
)
