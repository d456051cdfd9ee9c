"""The declaration of the driver of FARO trackers, not run against hardware yet."""

from __future__ import annotations

from drivers.bridge.details import battery_of, clock_of
from drivers.declaration import InstrumentDriver
from drivers.faro.ion import FaroTracker

DRIVERS = (
    InstrumentDriver(
        name="faro",
        maker="FARO",
        instrument="faro-ion",
        make=FaroTracker,
        needs_weather=True,
        unreported=("which SMR is seated",),
        details=battery_of,
        clock_s=clock_of,
    ),
)
