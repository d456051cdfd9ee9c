"""The declared manual drivers: a person drives the robot, or reads the instrument."""

from __future__ import annotations

from drivers.declaration import InstrumentDriver, Option, RobotDriver, TextOption
from drivers.manual.arm import RESOLUTION_DEG, ManualArm
from drivers.manual.meter import MM_OF, ManualMeter

_SERIAL = TextOption("serial", words="`manual`: serial number of the robot or the instrument.")

_RESOLUTION = f"`manual`: resolution of the pendant, deg or mm; left out: {RESOLUTION_DEG:g}."
_WITHIN = "`manual`: largest distance of a joint from the pose, deg or mm; left out: the resolution."

ROBOTS = (
    RobotDriver(
        name="manual",
        make=ManualArm,
        by_hand=True,
        options=(
            Option("resolution_deg", False, 1e-5, 1.0, RESOLUTION_DEG, _RESOLUTION),
            Option("within_deg", False, 1e-5, 10.0, words=_WITHIN),
            _SERIAL,
        ),
    ),
)
INSTRUMENTS = (
    InstrumentDriver(
        name="manual",
        maker="",
        instrument="manual",
        make=ManualMeter,
        by_hand=True,
        takes_within=True,
        options=(
            TextOption("unit", tuple(MM_OF), "mm", "`manual`: unit of its numbers; left out: mm."),
            _SERIAL,
        ),
    ),
)
