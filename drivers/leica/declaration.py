"""The declarations of the Leica drivers: behind a bridge, and over emScon packets.

They have not been run against hardware yet.
"""

from __future__ import annotations

from drivers.bridge.details import battery_of, clock_of
from drivers.declaration import InstrumentDriver, Option
from drivers.details import Details
from drivers.interfaces import InstrumentStatus
from drivers.leica.at960 import LeicaTracker
from drivers.leica.emscon import EmsconTracker


def _emscon_details(device: EmsconTracker, status: InstrumentStatus) -> Details:
    return Details(weather_station=device.has_weather_station())


DRIVERS = (
    InstrumentDriver(
        name="leica",
        maker="Leica",
        instrument="leica",
        make=LeicaTracker,
        options=(
            Option(
                "reflector_mm", words="`leica`: diameter of the SMR, mm; left out: as set at the tracker."
            ),
        ),
        needs_weather=True,
        streams=True,
        unreported=("which SMR is seated",),
        details=battery_of,
        clock_s=clock_of,
    ),
    InstrumentDriver(
        name="emscon",
        maker="Leica",
        instrument="emscon",
        make=EmsconTracker,
        finds_by_name=False,
        needs_weather=True,
        unreported=("which SMR is seated",),
        details=_emscon_details,
    ),
)
