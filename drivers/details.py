"""Details of a device beyond its common status, read without arming it.

Each protocol has something of its own; a driver's declaration says how to ask for it. For `truepose doctor`; a
campaign needs none of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from drivers.dh_numbers import DhNumbers
from drivers.errors import AcquisitionError


@dataclass(frozen=True, slots=True)
class Details:
    """The details of a device; None or empty where its protocol does not say.

    `trouble`: why it could not move now; `temperatures_c`: of the joints; `speed_share`: of the speed slider, 1 is
    full; `nominal`: DH numbers that the controller calculates with; `bar_mm`: calibrated length of the ballbar as it
    is built together; `bodies`: reflective targets of each; `reference`: the body on the robot's foot among them, and
    how many targets it needs.
    """

    trouble: AcquisitionError | None = None
    temperatures_c: tuple[float, ...] = ()
    speed_share: float | None = None
    nominal: DhNumbers | None = None
    weather_station: bool | None = None
    battery_percent: float | None = None
    bar_mm: float | None = None
    bodies: Mapping[str, int] = field(default_factory=dict)
    reference: tuple[str, int] = ("", 0)
