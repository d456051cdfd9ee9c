"""The declaration of the driver of UR arms, not run against hardware yet."""

from __future__ import annotations

import struct
from contextlib import suppress

from drivers.declaration import RobotDriver
from drivers.details import Details
from drivers.errors import Busy, LinkError, WrongMode
from drivers.interfaces import RobotStatus
from drivers.ur.arm import UrArm
from drivers.ur.realtime import parse_packet
from drivers.ur.state import PLAYING, unfit

_TEMPERATURES, _SPEED = 692, 940  # offsets in the packet of 30003, by the maker's sheet


def _details(device: UrArm, status: RobotStatus) -> Details:
    """Return joint temperatures, speed slider, DH numbers, and obstacles to motion.

    Temperatures and slider come from 30003, DH numbers from 30002. Obstacles are a running program and local control.
    """
    state = parse_packet(status.raw)
    trouble = unfit(state, moving=False)
    if trouble is None and state.runtime_state == PLAYING:
        trouble = Busy(
            "a program runs on the controller",
            what_to_do="Stop the program on the pendant: the first move of a campaign would take its place.",
        )
    if trouble is None and device.in_remote_control() is False:
        trouble = WrongMode(
            "the controller is in local control: it ignores every program that is sent, a stop too",
            what_to_do="Switch the controller to remote control on the pendant.",
        )
    nominal = None
    with suppress(LinkError):  # the error was reported when the identity was read
        nominal = device.factory().nominal
    return Details(
        trouble=trouble,
        temperatures_c=struct.unpack_from(">6d", status.raw, _TEMPERATURES),
        speed_share=struct.unpack_from(">d", status.raw, _SPEED)[0],
        nominal=nominal,
    )


def _clock_s(device: UrArm) -> float:
    return parse_packet(device.status().raw).t_s


DRIVERS = (
    RobotDriver(name="ur", make=UrArm, takes_reach=True, streams=True, details=_details, clock_s=_clock_s),
)
