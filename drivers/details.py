"""Details of a device in addition to its common status, read without arming it.

Each protocol has its own; a driver's declaration has the function that reads them. They are for `truepose doctor`; a
campaign needs none of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.dh_numbers import ControllerCalibration, DhNumbers
from drivers.errors import AcquisitionError


@dataclass(frozen=True, slots=True)
class Details:
    """The details of a device; None or empty if its protocol does not report them.

    Attributes
    ----------
    trouble
        Reason why it could not move now.
    temperatures_c
        Temperatures of the joints.
    speed_share
        Position of the speed slider; 1 is full speed.
    nominal
        DH numbers of the type of the arm, as the controller has them.
    calibration
        The calibration of this arm with which the controller calculates.
    closed
        Services of the controller that are closed, by their names in its menu.
    opened_at
        Where a person opens them, as a sentence.
    bar_mm
        Calibrated length of the ballbar as it is built.
    bodies
        Number of reflective targets of each body.
    reference
        The body on the robot's foot among them, and the number of targets that it needs.
    second_channel
        What a second channel to the device says, as a sentence without its full stop.
    """

    trouble: AcquisitionError | None = None
    temperatures_c: tuple[float, ...] = ()
    speed_share: float | None = None
    nominal: DhNumbers | None = None
    calibration: ControllerCalibration | None = None
    closed: tuple[str, ...] = ()
    opened_at: str = ""
    weather_station: bool | None = None
    battery_percent: float | None = None
    bar_mm: float | None = None
    bodies: Mapping[str, int] = field(default_factory=dict)
    reference: tuple[str, int] = ("", 0)
    second_channel: str = ""
