"""The declared manual drivers: a person drives the robot, or reads the instrument."""

from __future__ import annotations

from drivers.declaration import InstrumentDriver, Option, RobotDriver, TextOption
from drivers.manual.arm import RESOLUTION_DEG, ManualArm
from drivers.manual.meter import MM_OF, ManualMeter

_SERIAL = TextOption("serial", words="`manual`: serial number of the robot or the instrument.")

ROBOTS = (
    RobotDriver(
        name="manual",
        make=ManualArm,
        by_hand=True,
        options=(
            Option(
                "resolution_deg",
                low=1e-5,
                high=1.0,
                default=RESOLUTION_DEG,
                words=f"`manual`: resolution of the angles on the pendant, deg or mm; left out: {RESOLUTION_DEG:g}.",
            ),
            Option(
                "within_deg",
                low=1e-5,
                high=10.0,
                words="`manual`: largest distance of a joint from the pose, deg or mm; left out: the resolution.",
            ),
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
            TextOption(
                "unit",
                allowed=tuple(MM_OF),
                default="mm",
                words="`manual`: unit of the numbers on the instrument; left out: mm.",
            ),
            _SERIAL,
        ),
    ),
)
