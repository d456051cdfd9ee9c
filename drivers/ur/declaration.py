"""The declaration of the driver of UR arms, not run against hardware yet."""

from __future__ import annotations

from contextlib import suppress

from drivers.declaration import RobotDriver
from drivers.details import Details
from drivers.errors import Busy, LinkError
from drivers.interfaces import RobotStatus
from drivers.ur.arm import UrArm
from drivers.ur.software import where_enabled
from drivers.ur.state import PLAYING, unfit

_ENOUGH = (
    "A campaign needs RTDE and the Primary Client Interface; each of the others is one more way to stop."
)


def _details(device: UrArm, status: RobotStatus) -> Details:
    """Return temperatures, speed slider, DH numbers, closed services, obstacles to motion.

    Temperatures are those of the joints; obstacles are a running program and local control.
    """
    state = device.look()
    trouble = unfit(state, moving=False)
    if trouble is None and state.runtime_state == PLAYING:
        trouble = Busy(
            "a program runs on the controller",
            what_to_do="Stop the program on the pendant: the first move of a campaign would take its place.",
        )
    trouble = trouble or device.local_control()
    nominal = calibration = None
    with suppress(LinkError):  # the error was reported when the identity was read
        factory = device.factory()
        nominal, calibration = factory.nominal, factory.held
    closed = device.closed_services()
    return Details(
        trouble=trouble,
        temperatures_c=state.temperatures_c,
        speed_share=state.speed_share,
        nominal=nominal,
        calibration=calibration,
        closed=closed,
        opened_at=f"{_ENOUGH} {where_enabled(', '.join(closed), device.software())}" if closed else "",
    )


def _clock_s(device: UrArm) -> float:
    return device.look().t_s


DRIVERS = (
    RobotDriver(name="ur", make=UrArm, takes_reach=True, streams=True, details=_details, clock_s=_clock_s),
)
