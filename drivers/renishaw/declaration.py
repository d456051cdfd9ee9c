"""The declaration of the driver of Renishaw's ballbar, not run against hardware yet."""

from __future__ import annotations

from dataclasses import replace

from drivers.bridge import mbp
from drivers.bridge.details import battery_of, clock_of
from drivers.declaration import InstrumentDriver, Option
from drivers.details import Details
from drivers.interfaces import InstrumentStatus
from drivers.renishaw.qc20w import STROKE_MM, Qc20w

_LONGEST_BAR_MM = 5000.0


def _details(device: Qc20w, status: InstrumentStatus) -> Details:
    """Return the battery charge of the ballbar and the calibrated length of the bar (CAL)."""
    reply = device.session.ask("CAL", {})
    with device.session.understood():
        length = mbp.number(reply, "L0", 1.0, _LONGEST_BAR_MM)
    return replace(battery_of(device, status), bar_mm=length)


DRIVERS = (
    InstrumentDriver(
        name="qc20w",
        maker="Renishaw",
        instrument="qc20w",
        make=Qc20w,
        options=(
            Option(
                "nominal_mm",
                needed=True,
                words="`qc20w`, must be given: length of the ballbar with its extensions, mm.",
            ),
        ),
        stroke_mm=STROKE_MM,
        body_mm=100.0,
        extensions_mm=(50.0, 150.0, 300.0),
        details=_details,
        clock_s=clock_of,
    ),
)
